//! Files that change while the program reads them, and text that must not reach a terminal.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use spinney::edit::{Edit, FillRegion, Note, edit};
use spinney::raw::dataset::open;
use spinney::{Bounds, Error, OpenOptions, Output, WriteOptions, convert};

use crate::common::command::{command, complaint, spinney, stderr, stdout};

const PROGRAM: &str = env!("CARGO_BIN_EXE_spinney");

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

fn is_changed(result: spinney::Result<()>) -> bool {
    matches!(result, Err(Error::Changed { .. }))
}

#[test]
fn a_published_file_that_is_overwritten_or_cut_short_is_noticed() {
    let directory = tempfile::tempdir().unwrap();
    let (path, other) = (directory.path().join("t.goblin"), directory.path().join("other.goblin"));
    for options in [OpenOptions::new(), OpenOptions::new().positioned(1 << 20)] {
        std::fs::copy(fixture("v1/classes.goblin"), &path).unwrap();
        let tree = open(&path, &options).unwrap();
        tree.check_unchanged().unwrap();
        // A replaced file does not affect the open one, and links and permissions do not matter.
        std::fs::hard_link(&path, &other).unwrap();
        std::fs::remove_file(&path).unwrap();
        tree.check_unchanged().unwrap();
        let bytes = std::fs::read(&other).unwrap();
        let mut file = std::fs::File::options().write(true).open(&other).unwrap();
        file.write_all(&bytes).unwrap();
        file.set_modified(std::time::SystemTime::now() + Duration::from_secs(3)).unwrap();
        assert!(is_changed(tree.check_unchanged()), "overwritten with as many bytes");
        file.set_len(100).unwrap();
        assert!(is_changed(tree.check_unchanged()), "cut short");
        std::fs::remove_file(&other).unwrap();
    }
}

#[test]
fn outputs_respect_the_size_limit() {
    let directory = tempfile::tempdir().unwrap();
    let (tree, out) = (fixture("v1/classes.goblin"), directory.path().join("out.goblin"));
    let commands: [&[&str]; 4] =
        [&["convert"], &["transform", "rotate=90", "-o"], &["combine", "over", "-o"], &["compact", "-o"]];
    for words in commands {
        let tree = if words[0] == "compact" { fixture("v1/history.autumn") } else { tree.clone() };
        let out = if words[0] == "compact" { out.with_extension("autumn") } else { out.clone() };
        let run = |most: &str| {
            let mut command = Command::new(PROGRAM);
            let (first, rest) = words.split_first().unwrap();
            command.arg(first).args(["--max-bytes", most]);
            match words {
                ["combine", operation, ..] => command.args([operation]).arg(&tree).arg("-o").arg(&out),
                ["convert"] => command.arg(&tree).arg(&out),
                _ => command.arg(&tree).args(rest).arg(&out),
            };
            command.output().unwrap()
        };
        let refused = run("200");
        let message = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(!refused.status.success() && message.contains("200"), "{words:?}: {message}");
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0, "{words:?}");
        let made = run("1M");
        assert!(made.status.success(), "{words:?}: {}", String::from_utf8_lossy(&made.stderr));
        std::fs::remove_file(&out).unwrap();
    }
}

#[test]
fn an_edited_file_may_grow_but_not_lose_commits() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.autumn");
    convert(
        &fixture("v1/classic.goblin"),
        false,
        Output::create(&path).unwrap(),
        WriteOptions::new(1 << 20),
        &(),
    )
    .unwrap();
    let fill = |value: f64| {
        let region = FillRegion::Box(Bounds { min: [1, 1, 0], max: [4, 6, 1] });
        edit(&path, [Ok(Edit::Fill(region, Some(vec![value.into()])))], Note::default(), 1 << 20, &())
            .unwrap();
    };
    let old = std::fs::read(&path).unwrap();
    fill(2.0);
    let tree = open(&path, &OpenOptions::new()).unwrap();
    fill(3.0);
    tree.check_unchanged().unwrap();
    // An older copy, written over the file.
    let mut file = std::fs::File::options().write(true).open(&path).unwrap();
    file.write_all(&old).unwrap();
    assert!(is_changed(tree.check_unchanged()));
    file.set_len(3 * 4096).unwrap();
    assert!(is_changed(tree.check_unchanged()));
}

#[test]
#[cfg(target_os = "linux")]
fn a_file_that_is_cut_short_while_it_is_read_ends_the_program_with_a_message() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.goblin");
    // Large enough that most of it is not in the first pages.
    let small = fixture("island_classes.tif");
    spinney(&["-q", "build", small.to_str().unwrap(), "-o", path.to_str().unwrap()]).success();
    assert!(std::fs::metadata(&path).unwrap().len() > 3 * 4096);
    for how in [&[][..], &["--positioned"]] {
        spinney(&["-q", "build", small.to_str().unwrap(), "-o", path.to_str().unwrap()]).success();
        let mut child = Command::new(PROGRAM)
            .args(how)
            .args(["point", "--in", "cells"])
            .arg(&path)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let start = Instant::now();
        let is_open = |id: u32| {
            let files = std::fs::read_dir(format!("/proc/{id}/fd")).into_iter().flatten().flatten();
            files.filter_map(|file| std::fs::read_link(file.path()).ok()).any(|file| file == path)
        };
        while !is_open(child.id()) && start.elapsed() < Duration::from_secs(10) {
            std::thread::sleep(Duration::from_millis(1));
        }
        // The program has read what opening reads, or will find the file truncated.
        std::thread::sleep(Duration::from_millis(100));
        std::fs::File::options().write(true).open(&path).unwrap().set_len(100).unwrap();
        let mut input = child.stdin.take().unwrap();
        for cell in 0..100 {
            let _ = writeln!(input, "{cell},{cell}");
        }
        drop(input);
        let mut text = String::new();
        child.stderr.take().unwrap().read_to_string(&mut text).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(1), "{how:?}: {text}");
        assert!(text.starts_with("spinney: "), "{how:?}: {text}");
    }
}

#[test]
fn positioned_reads_give_the_same_results() {
    let file = fixture("v1/classes.goblin");
    let file = file.to_str().unwrap();
    for query in [&["info", file][..], &["stats", file], &["dump", file, "--codes"]] {
        let positioned: Vec<&str> = ["--positioned"].iter().chain(query).copied().collect();
        assert_eq!(stdout(&positioned), stdout(query));
    }
}

#[test]
#[cfg(target_os = "linux")]
fn results_for_a_closed_standard_output_are_a_failure() {
    let file = fixture("v1/classes.goblin");
    for query in [&["info"][..], &["stats"], &["get", "-", "--format", "raw"]] {
        let mut shell = Command::new("sh");
        shell.args(["-c", "exec \"$@\" >&-", "sh", PROGRAM, query[0]]).arg(&file).args(&query[1..]);
        let run = shell.output().unwrap();
        let text = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(1), "{query:?}: {text}");
        assert!(text.contains("standard output is closed"), "{text}");
        // Output that the caller discards is not an error.
        let run =
            Command::new(PROGRAM).arg(query[0]).arg(&file).args(&query[1..]).stdout(Stdio::null()).status();
        assert!(run.unwrap().success());
    }
}

#[test]
fn escape_sequences_of_names_never_reach_a_terminal() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a\u{1b}]0;title\u{7}\u{9b}31m.goblin");
    std::fs::copy(fixture("v1/classes.goblin"), &path).unwrap();
    let name = path.to_str().unwrap();
    let missing = format!("{name}.missing");
    let copy = directory.path().join("b\u{1b}[2J.goblin");
    let output = stderr(spinney(&["transform", name, "crop", "-o", copy.to_str().unwrap()]).success());
    let outputs =
        [stdout(&["verify", name]), stdout(&["info", name]), complaint(&["info", &missing], 1), output];
    let usage = complaint(&[&format!("a{}", "\u{1b}]0;title\u{7}.goblin")], 2);
    for text in outputs.into_iter().chain([usage]) {
        assert!(!text.chars().any(|c| c.is_control() && c != '\n' && c != '\t'), "{text:?}");
        assert!(text.contains(".goblin"), "{text:?}");
    }
}

#[test]
fn any_number_of_threads_can_be_requested() {
    let file = fixture("v1/classes.goblin");
    spinney(&["--threads", "65535", "info", file.to_str().unwrap()]).success();
}

#[test]
#[cfg(target_os = "linux")]
fn every_writing_command_reports_a_full_disk() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let [map, ball, history, model] =
        [path("map.goblin"), path("ball.goblin"), path("history.autumn"), path("ball.ply")];
    std::fs::copy(fixture("v1/classes.goblin"), &map).unwrap();
    std::fs::copy(fixture("v1/ball.goblin"), &ball).unwrap();
    std::fs::copy(fixture("v1/history.autumn"), &history).unwrap();
    spinney(&["-q", "export", &ball, &model]).success();
    let tif = fixture("island_elevation.tif").to_str().unwrap().to_owned();
    let old = |name: &str| {
        std::fs::write(directory.path().join(name), "old").unwrap();
        path(name)
    };
    let commands: [&[&str]; 12] = [
        &["build", &tif, "-o", &old("a.goblin")],
        &["build", &tif, "-o", &path("b.autumn")],
        &["build", &model, "-o", &old("c.goblin")],
        &["convert", &map, &path("d.autumn")],
        &["compact", &history, "-o", &path("e.autumn")],
        &["transform", &map, "rotate=30", "-o", &old("f.goblin")],
        &["combine", "union", &map, &map, "-o", &old("g.goblin")],
        &["get", &map, &old("h.tif")],
        &["export", &ball, &old("i.ply")],
        &["export", &ball, &old("k.glb")],
        &["export", &ball, &path("l/tileset.json")],
        &["render", &ball, &old("j.png")],
    ];
    let files = || {
        let entries = std::fs::read_dir(directory.path()).unwrap().map(|entry| entry.unwrap().path());
        let mut files: Vec<_> = entries.map(|path| (path.clone(), std::fs::read(path).unwrap())).collect();
        files.sort();
        files
    };
    let before = files();
    // A limit in blocks of 512 or 1024 bytes: no output, or some of it.
    for blocks in [0, 3] {
        for command in commands {
            let mut shell = Command::new("sh");
            shell
                .args(["-c", &format!("ulimit -f {blocks}; exec \"$@\""), "sh", PROGRAM, "-q"])
                .args(command);
            let run = shell.output().unwrap();
            let text = String::from_utf8_lossy(&run.stderr);
            assert_eq!(run.status.code(), Some(1), "{blocks} blocks, {command:?}: {text}");
            assert!(text.starts_with("spinney: ") && text.contains("File too large"), "{command:?}: {text}");
            assert!(files() == before, "{blocks} blocks, {command:?}");
        }
    }
    // Standard output is a full disk.
    for command in [
        &["get", &map, "-", "--format", "tif"][..],
        &["dump", &map, "--codes"],
        &["stats", &map],
        &["info", &map],
    ] {
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let run = Command::new(PROGRAM).arg("-q").args(command).stdout(full).output().unwrap();
        let text = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(1), "{command:?}: {text}");
        assert!(text.contains("No space left"), "{command:?}: {text}");
    }
}

#[cfg(unix)]
#[test]
fn pipes_are_refused_where_files_are_read_more_than_once() {
    let directory = tempfile::tempdir().unwrap();
    let name = |name: &str| directory.path().join(name).to_str().unwrap().to_owned();
    let (pipe, out) = (name("pipe.tif"), name("out.goblin"));
    // The pipe has no writer: opening it would block forever.
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for words in [
        &["build", &pipe, "-o", &out][..],
        &["info", &pipe],
        &["stats", &pipe],
        &["transform", &pipe, "-o", &out],
        &["combine", "union", &pipe, &pipe, "-o", &out],
        &["verify", &pipe],
        &["get", &pipe, &out],
    ] {
        let run = command(words).timeout(std::time::Duration::from_secs(60)).assert().failure();
        let message = stderr(run);
        assert!(message.contains("pipe"), "{words:?}: {message}");
    }
}

/// Multi-file outputs on a disk that fills up: all files are written or none, without leftover
/// directories.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_leaves_no_partial_set_of_files() {
    let directory = tempfile::tempdir().unwrap();
    let disk = directory.path().join("disk");
    std::fs::create_dir(&disk).unwrap();
    let run = |program: &str, words: &[&str]| std::process::Command::new(program).args(words).status();
    let at = disk.to_str().unwrap();
    let mounted =
        run("mount", &["-t", "tmpfs", "-o", "size=400k", "tmpfs", at]).is_ok_and(|code| code.success());
    if !mounted {
        eprintln!("skipped: no file system can be mounted here");
        return;
    }
    let map = format!("{}/fixtures/v1/elevation.goblin", env!("CARGO_MANIFEST_DIR"));
    let name = |name: &str| disk.join(name).to_str().unwrap().to_owned();
    let files = || {
        let found =
            std::fs::read_dir(&disk).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        found.collect::<Vec<_>>()
    };
    let mut failed = 0;
    // With increasing space: each command first fails, at a different point each time.
    for space in (0..400).step_by(20) {
        std::fs::write(name("filler"), vec![0; (400 - space) << 10]).unwrap_or_default();
        for words in [
            &["contours", &map, "--every", "5", "-o", &name("lines.shp")][..],
            &["export", &map, "-o", &name("new/page/index.html")],
            &["export", &map, "-o", &name("new/tiles/{z}/{x}/{y}.png")],
        ] {
            let output = command(&[&["-q"], words].concat()).output().unwrap();
            if output.status.success() {
                for file in files().iter().filter(|file| *file != "filler") {
                    let path = disk.join(file);
                    std::fs::remove_dir_all(&path).or_else(|_| std::fs::remove_file(&path)).unwrap();
                }
                continue;
            }
            failed += 1;
            let text = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(1), "{words:?}: {text}");
            assert!(files().iter().all(|file| file == "filler"), "{space}, {words:?}: {:?}: {text}", files());
        }
    }
    run("umount", &[at]).unwrap();
    assert!(failed > 3);
}

/// URLs in help are examples: nothing is redacted, and help is not an error message.
#[test]
fn help_is_shown_as_it_is() {
    let text = stdout(&["serve", "--help"]);
    assert!(text.contains("/point/relief?x=7.66&y=45.98") && text.contains("--remote-timeout"), "{text}");
}

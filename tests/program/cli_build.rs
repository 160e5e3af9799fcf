//! `spinney build` from the user's side.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use assert_cmd::Command;
use spinney::OpenOptions;
use spinney::raw::store::goblin::Goblin;

use crate::common::QUAD;
use crate::common::command::{interruptible, peak_memory};
use crate::common::tiff_file::{Ifd, Values, file};

const PROGRAM: &str = env!("CARGO_BIN_EXE_spinney");

/// Runs the program. Returns its exit code, standard output and standard error.
fn run(args: &[&str], directory: &Path) -> (Option<i32>, Vec<u8>, String) {
    let output = Command::new(PROGRAM).args(args).current_dir(directory).output().unwrap();
    (output.status.code(), output.stdout, String::from_utf8(output.stderr).unwrap())
}

/// Returns a directory with a small grey image `p.tif`.
fn small() -> tempfile::TempDir {
    let directory = tempfile::tempdir().unwrap();
    let strip = (0..300 * 200).map(|i: u32| (i % 300 / 9 + i / 300 / 7) as u8).collect();
    fs::write(directory.path().join("p.tif"), file(&[Ifd::grey(300, 200, strip)])).unwrap();
    directory
}

/// Writes an image of 2^14 x 2^12 pixels: one in 64 chunks is a ramp, the others are uniform.
fn large(directory: &Path, tiled: bool) -> PathBuf {
    let chunk = |pixel: &dyn Fn(u32, u32) -> u8, width: u32, height: u32| {
        let pixels: Vec<u8> = (0..height).flat_map(|y| (0..width).map(move |x| pixel(x, y))).collect();
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(&pixels).unwrap();
        encoder.finish().unwrap()
    };
    let [columns, rows]: [u32; 2] = [1 << 14, 1 << 12];
    let [width, height] = if tiled { [1024, 1024] } else { [columns, 32] };
    let ramp = chunk(&|x, y| ((x / 3 + y / 5) % 256) as u8, width, height);
    let flat: Vec<Vec<u8>> = (0..5).map(|value| chunk(&|_, _| value, width, height)).collect();
    let count = (columns / width * (rows / height)) as usize;
    let chunks: Vec<Vec<u8>> =
        (0..count).map(|i| if i % 64 == 5 { ramp.clone() } else { flat[i / 3 % 5].clone() }).collect();
    let ifd = Ifd::grey(0, 0, Vec::new())
        .tag(256, Values::Long(vec![columns]))
        .tag(257, Values::Long(vec![rows]))
        .short(259, &[8]);
    let ifd = if tiled {
        ifd.short(322, &[width as u16]).short(323, &[height as u16])
    } else {
        ifd.short(278, &[height as u16])
    };
    let path = directory.join(if tiled { "tiles.tif" } else { "strips.tif" });
    fs::write(&path, file(&[ifd.chunks(&chunks)])).unwrap();
    path
}

/// Returns the names of all files in a directory, including hidden ones.
fn names(directory: &Path) -> Vec<String> {
    let names =
        fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

#[test]
fn a_raster_becomes_a_tree() {
    let directory = small();
    let (code, out, err) = run(&["build", "p.tif", "-o", "p.goblin"], directory.path());
    assert_eq!((code, out.as_slice()), (Some(0), &b""[..]), "{err}");
    for expected in
        ["300 x 200 pixels", "1 channel of u8", "continuous", "mean", "p.goblin: ", "of the input's 58."]
    {
        assert!(err.contains(expected), "{expected}: {err}");
    }
    let tree = Goblin::open(&directory.path().join("p.goblin"), &OpenOptions::new()).unwrap();
    assert_eq!((tree.header().form, tree.header().extent), (QUAD, [300, 200, 1]));
    let (code, out, err) = run(&["build", "p.tif", "-o", "-", "--quiet"], directory.path());
    assert_eq!((code, err.as_str()), (Some(0), ""));
    assert!(out == fs::read(directory.path().join("p.goblin")).unwrap());
    assert_eq!(names(directory.path()), ["p.goblin", "p.tif"]);
}

#[test]
fn threads_do_not_change_the_bytes() {
    let directory = small();
    let build = |threads| {
        run(&["build", "p.tif", "-qo", "-", "--kind", "categorical", "--threads", threads], directory.path())
            .1
    };
    let one = build("1");
    assert!(!one.is_empty() && one == build("2") && one == build("5"));
}

#[test]
fn failures_are_reported_and_leave_no_files() {
    let directory = small();
    fs::write(directory.path().join("text.tif"), "no raster").unwrap();
    let whole = fs::read(directory.path().join("p.tif")).unwrap();
    // The tags are at the end; an offset of samples beyond the file is only found when building.
    let mut corrupt = whole.clone();
    let offset = corrupt.windows(8).position(|tag| tag == [0x11, 1, 4, 0, 1, 0, 0, 0]).unwrap() + 8;
    corrupt[offset..offset + 4].copy_from_slice(&(whole.len() as u32 - 10).to_le_bytes());
    fs::write(directory.path().join("corrupt.tif"), corrupt).unwrap();
    fs::write(directory.path().join("old.goblin"), "old").unwrap();
    std::os::unix::fs::symlink("p.tif", directory.path().join("link.tif")).unwrap();
    let before = names(directory.path());
    for (args, expected_code, expected) in [
        (&["build", "none.tif", "-o", "old.goblin"][..], 1, "none.tif: cannot open"),
        (&["build", "text.tif", "-o", "old.goblin"], 1, "text.tif: a file of this format is not supported"),
        (&["build", "corrupt.tif", "-qo", "old.goblin"], 1, "corrupt.tif"),
        (&["build", "p.tif", "-o", "p.tif"], 1, "is an input and the output"),
        (&["build", "p.tif", "-o", "link.tif"], 1, "is an input and the output"),
        (&["build", "p.tif", "-o", "none/p.goblin", "-q"], 1, "none/p.goblin: cannot create"),
        (&["build", "p.tif", "-qo", "x.goblin", "--band", "2"], 1, "--band: got 2"),
        (&["build", "p.tif", "-qo", "x.goblin", "--depth", "8"], 1, "--depth: got 8"),
        (&["build", "p.tif", "-o", "x.goblin", "--memory", "lots"], 2, "--memory"),
        (&["build", "p.tif", "-o", "x.goblin", "--transform", "1,2"], 2, "expected 6 numbers"),
        (&["build", "p.tif", "-o", "x.goblin", "--rule", "best"], 2, "mean, majority"),
        (
            &["build", "p.tif", "-qo", "x.goblin", "--kind", "categorical", "--rule", "mean"],
            1,
            "p.tif: the rule mean for categorical values is not supported; averages of class numbers",
        ),
        (&["build", "p.tif", "-o", "x.goblin", "--threads", "0"], 2, "--threads"),
        (&["build", "p.tif"], 2, "--output"),
        (&["build"], 2, "INPUT"),
        (&["plant"], 2, "plant"),
    ] {
        let (code, _, err) = run(args, directory.path());
        assert_eq!(code, Some(expected_code), "{args:?}: {err}");
        assert!(err.contains(expected), "{args:?}: {err}");
        if expected_code == 1 {
            assert!(err.starts_with("spinney: ") && err.lines().count() == 1, "{args:?}: {err}");
        }
        assert_eq!(names(directory.path()), before, "{args:?}");
    }
    assert_eq!(fs::read(directory.path().join("old.goblin")).unwrap(), b"old");
    assert!(fs::read(directory.path().join("p.tif")).unwrap() == whole);
}

#[test]
fn completions_and_help() {
    let directory = tempfile::tempdir().unwrap();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let (code, out, _) = run(&["completions", shell], directory.path());
        assert!(code == Some(0) && String::from_utf8(out).unwrap().contains("spinney"), "{shell}");
    }
    let (code, out, _) = run(&["build", "--help"], directory.path());
    assert!(code == Some(0) && String::from_utf8(out).unwrap().contains("Examples:"));
}

#[test]
fn a_reader_that_closes_the_pipe_is_not_an_error() {
    let directory = small();
    let mut command = std::process::Command::new(PROGRAM);
    command.args(["build", "p.tif", "-qo", "-"]).current_dir(directory.path());
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), output.stderr.as_slice()), (Some(141), &b""[..]));
}

fn start(mut program: std::process::Command, args: &[&str], directory: &Path) -> Child {
    program.args(args).current_dir(directory).stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
fn cancellation_leaves_no_files() {
    if interruptible(PROGRAM).is_none() {
        return;
    }
    let input = tempfile::tempdir().unwrap();
    let input = large(input.path(), true).canonicalize().map(|path| (path, input)).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let args = ["build", input.0.to_str().unwrap(), "-qo", "t.goblin", "--threads", "1"];
    let interrupted = || {
        let child = start(interruptible(PROGRAM).unwrap(), &args, directory.path());
        let deadline = Instant::now() + Duration::from_secs(20);
        while names(directory.path()).is_empty() && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(1));
        }
        let pid = rustix::process::Pid::from_child(&child);
        rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
        child.wait_with_output().unwrap()
    };
    // On a busy machine the program may have ended before the signal arrives.
    let outputs = std::iter::repeat_with(|| {
        let _ = fs::remove_file(directory.path().join("t.goblin"));
        interrupted()
    });
    let output =
        outputs.take(20).find(|output| !output.status.success()).expect("one is interrupted in time");
    let err = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(130), "{err}");
    assert!(err.starts_with("spinney: interrupted"), "{err}");
    assert!(names(directory.path()).is_empty());
}

#[test]
#[cfg(target_os = "linux")]
fn memory_stays_within_its_budget() {
    /// Allowance in bytes for the program, thread stacks and allocator overhead.
    const ALLOWANCE: u64 = 32 << 20;
    let directory = tempfile::tempdir().unwrap();
    // With so little memory, strips are copied to a temporary file.
    for (tiled, memory, budget) in [(true, "64M", 64 << 20), (false, "24M", 24 << 20)] {
        let path = large(directory.path(), tiled);
        let args = ["build", path.to_str().unwrap(), "-qo", "t.goblin", "--memory", memory];
        let peak = peak_memory(&mut start(std::process::Command::new(PROGRAM), &args, directory.path()));
        assert!(peak > 0 && peak < budget + ALLOWANCE, "{} MiB with {memory}", peak >> 20);
    }
    // Operations on the tree of the same image: its file is small, so that mapped bytes hardly
    // count. The warper has a window of a million f64 samples for each of two threads.
    const WINDOWS: u64 = 16 << 20;
    let jobs: [(&[&str], u64); 4] = [
        (&["transform", "t.goblin", "rotate=17", "-o", "turned.goblin"], 0),
        (&["transform", "t.goblin", "window=101,33,15000,4000", "-o", "part.goblin"], 0),
        (&["transform", "turned.goblin", "like=t.goblin,extent=a", "-o", "like.goblin"], WINDOWS),
        (&["combine", "xor", "t.goblin", "like.goblin", "-o", "xor.goblin"], 0),
    ];
    for (job, windows) in jobs {
        let arguments = [job, &["-q", "--memory", "16M"]].concat();
        let peak = peak_memory(&mut start(std::process::Command::new(PROGRAM), &arguments, directory.path()));
        assert!(peak < (16 << 20) + windows + ALLOWANCE, "{} MiB for {job:?}", peak >> 20);
    }
}

//! Several processes that use one Autumnal file: a writer that dies among readers; two writers; a
//! full disk.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use spinney::edit::{Edit, Editor, FillRegion, Note, edit};
use spinney::raw::dataset::open;
use spinney::raw::store::autumnal::Autumnal;
use spinney::{Bounds, Code, DataKind, Dimension, Output, Rule, WriteOptions, convert};
use tempfile::TempDir;

use crate::common::{QUAD, Random, as_byte, byte, goblin_bytes, made};

const SIDE: u64 = 300;

/// Returns a file whose commits have similar cells.
fn file() -> (TempDir, PathBuf) {
    let directory = tempfile::tempdir().unwrap();
    let (goblin, path) = (directory.path().join("t.goblin"), directory.path().join("t.autumn"));
    let cells = made(QUAD, [SIDE, SIDE, 1], |_| Some(byte(7)));
    std::fs::write(&goblin, goblin_bytes(&cells, Rule::Mean, DataKind::Continuous)).unwrap();
    convert(&goblin, false, Output::create(&path).unwrap(), WriteOptions::new(1 << 20), &()).unwrap();
    std::fs::remove_file(goblin).unwrap();
    (directory, path)
}

/// Checks as a reader that all cells of a file belong to one commit. Returns its number.
fn read_all(path: &Path) -> u64 {
    let tree = open(path, &Default::default()).unwrap();
    let statistics = tree.statistics(None, &()).unwrap();
    assert_eq!(statistics.cells, SIDE * SIDE);
    // Each commit has stripes of a value and the next one.
    let channel = statistics.channels[0];
    assert!(channel.max.to_f64() - channel.min.to_f64() <= 1.0, "{channel:?}");
    let mut bytes = vec![0; (SIDE * SIDE) as usize];
    let all = Bounds::of_extent([SIDE, SIDE, 1]);
    tree.window(tree.depth(), &all, 0.0, &mut bytes, None).unwrap();
    let sum: u64 = bytes.iter().map(|byte| u64::from(*byte)).sum();
    assert_eq!(sum as f64 / (SIDE * SIDE) as f64, channel.mean);
    tree.commit().unwrap().number
}

/// Writes stripes of two values as a tree file.
fn stripes(directory: &Path, value: u64) -> PathBuf {
    let path = directory.join("stripes.csv");
    let mut text = String::new();
    for y in 0..SIDE {
        for x in 0..SIDE {
            text += &format!("{x},{y},{}\n", value + y % 2);
        }
    }
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn a_writer_that_is_killed_leaves_a_whole_commit_to_any_reader() {
    let (directory, path) = file();
    let (stop, reads) = (AtomicBool::new(false), AtomicU64::new(0));
    let mut random = Random(3);
    thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                let mut newest = 0;
                while !stop.load(Ordering::Relaxed) {
                    let number = read_all(&path);
                    assert!(number >= newest, "commit {number} after {newest}");
                    newest = number;
                    reads.fetch_add(1, Ordering::Relaxed);
                }
            });
        }
        let mut newest = 1;
        for round in 0..25 {
            let cells = stripes(directory.path(), 10 + round);
            let mut child = Command::new(env!("CARGO_BIN_EXE_spinney"))
                .args(["edit", "-q"])
                .arg(&path)
                .arg("set")
                .arg(&cells)
                .spawn()
                .unwrap();
            thread::sleep(Duration::from_micros(random.below(60_000)));
            let _ = child.kill();
            child.wait().unwrap();
            let number = read_all(&path);
            assert!(number == newest || number == newest + 1, "commit {number} after {newest}");
            newest = number;
        }
        stop.store(true, Ordering::Relaxed);
    });
    assert!(reads.load(Ordering::Relaxed) > 20);
    let tree = open(&path, &Default::default()).unwrap();
    assert_eq!(tree.verify(1 << 24, &()).unwrap(), []);
    for number in 1..=tree.commit().unwrap().number {
        read_all(format!("{}@{number}", path.display()).as_ref());
    }
}

#[test]
fn the_second_writer_learns_who_holds_the_lock() {
    let (_directory, path) = file();
    let editor = Editor::open(&path, 1 << 20).unwrap();
    let run = Command::new(env!("CARGO_BIN_EXE_spinney"))
        .arg("edit")
        .arg(&path)
        .args(["fill", "--window", "0,0,9,9", "--value", "1"])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(1), "{text}");
    assert!(text.contains(&format!("is being edited by process {}", std::process::id())), "{text}");
    drop(editor);
    assert_eq!(read_all(&path), 1);
}

#[test]
fn a_full_disk_loses_nothing() {
    let (directory, path) = file();
    let cells = stripes(directory.path(), 90);
    let before = std::fs::metadata(&path).unwrap().len();
    // File size limits in blocks of 512 bytes: no further byte, or a few pages.
    for blocks in [before / 512, before / 512 + 8, before / 512 + 100] {
        let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$@\"");
        let run = Command::new("sh")
            .args(["-c", &script, "sh", env!("CARGO_BIN_EXE_spinney"), "edit"])
            .arg(&path)
            .arg("set")
            .arg(&cells)
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(1), "{blocks} blocks: {text}");
        assert!(text.contains("t.autumn"), "{text}");
        assert_eq!(read_all(&path), 1);
        assert_eq!(open(&path, &Default::default()).unwrap().verify(1 << 24, &()).unwrap(), []);
    }
    // With free space the edit succeeds.
    let run = Command::new(env!("CARGO_BIN_EXE_spinney"))
        .args(["edit", "-q"])
        .arg(&path)
        .arg("set")
        .arg(&cells)
        .status();
    assert!(run.unwrap().success());
    assert_eq!(read_all(&path), 2);
}

#[test]
fn a_reader_keeps_its_commit_when_the_file_is_compacted_and_replaced() {
    let (directory, path) = file();
    for value in 1..20 {
        let region = FillRegion::Box(Bounds::of_extent([SIDE, SIDE, 1]));
        edit(&path, [Ok(Edit::Fill(region, Some(vec![value.into()])))], Note::default(), 1 << 20, &())
            .unwrap();
    }
    let mut reader = Autumnal::open(&path, &Default::default()).unwrap();
    let small = directory.path().join("small.autumn");
    let run = Command::new(env!("CARGO_BIN_EXE_spinney"))
        .args(["compact", "-q"])
        .arg(&path)
        .arg("-o")
        .arg(&small)
        .args(["--keep", "2"])
        .status();
    assert!(run.unwrap().success());
    std::fs::rename(&small, &path).unwrap();
    let value = |reader: &Autumnal| {
        let code = Code::from_cell(Dimension::Quad, 9, [5, 5, 0]).unwrap();
        reader.value_at(code).unwrap().map(as_byte)
    };
    assert_eq!((reader.commit().number, value(&reader)), (20, Some(19)));
    let region = FillRegion::Box(Bounds::of_extent([SIDE, SIDE, 1]));
    edit(&path, [Ok(Edit::Fill(region, Some(vec![77.0.into()])))], Note::default(), 1 << 20, &()).unwrap();
    assert_eq!((reader.commit().number, value(&reader)), (20, Some(19)));
    assert!(reader.refresh().unwrap());
    assert_eq!((reader.commit().number, value(&reader)), (21, Some(77)));
}

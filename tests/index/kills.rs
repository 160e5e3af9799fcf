//! Programs that are killed at random while they make or update an index: the file is the old one
//! or the new one, and the next run completes it.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::Random;
use crate::compare::Directory;
use crate::tiffs::{Chunks, Tiff};

/// Returns the command that makes or updates `x.goblin`.
fn program(directory: &Directory, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_spinney"));
    command.current_dir(directory.path("")).args(["-q", "index"]).args(arguments).stderr(Stdio::null());
    command
}

#[test]
fn killed_at_random() {
    let directory = Directory::new();
    for number in 0..40u64 {
        let origin = Some([(number % 8 * 300) as i64, (number / 8 * 280) as i64]);
        let tiff =
            Tiff { origin, chunks: Chunks::Tiles(64, 64), ..Tiff::new([300, 280], 3) }.filled(number + 1);
        tiff.write(&directory.path(&format!("{number:02}.tif")));
    }
    let first = &["0*.tif", "-o", "x.goblin"][..];
    let all = &["--update", "x.goblin", "*.tif"][..];
    let made = directory.path("x.goblin");
    let mut random = Random(66);
    let mut before: Option<Vec<u8>> = None;
    for arguments in [first, all] {
        let start = Instant::now();
        assert!(program(&directory, arguments).status().unwrap().success());
        let (length, after) = (start.elapsed(), fs::read(&made).unwrap());
        let restore = |path: &Path| match &before {
            Some(bytes) => fs::write(path, bytes).unwrap(),
            None => fs::remove_file(path).unwrap(),
        };
        restore(&made);
        for _ in 0..12 {
            let mut child = program(&directory, arguments).spawn().unwrap();
            std::thread::sleep(Duration::from_micros(random.below(length.as_micros() as u64 + 1)));
            child.kill().unwrap();
            child.wait().unwrap();
            match fs::read(&made).ok() {
                found if found == before => {}
                found => {
                    assert!(found.as_ref() == Some(&after), "{arguments:?}: another file");
                    restore(&made);
                }
            }
        }
        assert!(program(&directory, arguments).status().unwrap().success());
        assert!(fs::read(&made).unwrap() == after, "{arguments:?}");
        let names = fs::read_dir(directory.path("")).unwrap().map(|entry| entry.unwrap().file_name());
        let left: Vec<_> = names.filter(|name| !name.to_str().unwrap().ends_with(".tif")).collect();
        assert_eq!(left, ["x.goblin"], "{arguments:?}");
        before = Some(after);
    }
}

//! Merges that remove shards as they go: there is only disk space for one copy, and an interrupted
//! merge is resumed.

use std::fs;
use std::io::Write as _;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use spinney::Output;
use spinney::raw::io::CompletionRecord;

use crate::cli_shards::job;
use crate::common::command::{complaint, spinney, stderr};
use crate::common::directory::TestDirectory;

const PROGRAM: &str = env!("CARGO_BIN_EXE_spinney");

fn build_all(job: &str, shards: u32) {
    for number in 0..shards {
        spinney(&["-q", "shard", "build", job, &number.to_string()]).success();
    }
}

/// Returns the total size of a job's run files in bytes.
fn run_bytes(temp: &TestDirectory) -> u64 {
    let Ok(files) = fs::read_dir(temp.path("job/shards")) else { return 0 };
    let runs = files
        .map(|file| file.unwrap().path())
        .filter(|path| path.extension().is_some_and(|end| end == "run"));
    runs.map(|path| fs::metadata(path).unwrap().len()).sum()
}

#[test]
fn shards_are_removed_as_they_are_merged() {
    let temp = TestDirectory::new();
    let (job, whole) = job(&temp, "9");
    build_all(&job, 9);
    let (all, merged) = (run_bytes(&temp), temp.name("merged.goblin"));
    let merge = ["-q", "shard", "merge", &job, "-o", &merged, "--remove-shards"];
    // Killed repeatedly, later and later; finished work is kept.
    let mut left = all;
    for delay in (0..).step_by(2) {
        let mut child = Command::new(PROGRAM).args(merge).stderr(Stdio::null()).spawn().unwrap();
        sleep(Duration::from_millis(delay));
        child.kill().unwrap();
        child.wait().unwrap();
        let now = run_bytes(&temp);
        assert!(now <= left);
        left = now;
        if left < all || temp.path("merged.goblin").exists() {
            break;
        }
    }
    if !temp.path("merged.goblin").exists() {
        // Without --remove-shards the removed shards are missing.
        let plain = complaint(&["shard", "merge", &job, "-o", &temp.name("plain.goblin")], 1);
        assert!(plain.contains("missing"), "{plain}");
        spinney(&merge).success();
    }
    assert!(fs::read(&merged).unwrap() == whole);
    assert_eq!(temp.leftovers("."), ["merged.goblin", "p.tif", "whole.goblin"]);
}

#[test]
fn a_file_that_is_there_in_part_is_checked() {
    let temp = TestDirectory::new();
    let (job, whole) = job(&temp, "9");
    build_all(&job, 9);
    let merged = temp.name("merged.goblin");
    let merge = ["-q", "shard", "merge", &job, "-o", &merged, "--remove-shards"];
    let (partial, runs) = (temp.path("merged.goblin.partial"), temp.path("job/shards"));
    // As if killed after the first two runs: other remains do not matter.
    let header = &whole[..fs::read(temp.path("job/head.goblin"))
        .unwrap()
        .iter()
        .zip(&whole)
        .take_while(|(a, b)| a == b)
        .count()];
    let [first, second] = ["0000-0.run", "0001-0.run"].map(|name| fs::read(runs.join(name)).unwrap());
    let start = (0..=header.len()).find(|start| whole[*start..].starts_with(&first)).unwrap();
    let end = start + first.len() + second.len();
    let mut bytes = whole[..end].to_vec();
    bytes.extend_from_slice(&[7; 100_000]);
    fs::remove_file(runs.join("0000-0.run")).unwrap();
    fs::remove_file(runs.join("0001-0.run")).unwrap();
    // Without the partial file, a mark is created that names its job.
    assert!(complaint(&merge, 1).contains("build the shard again"));
    let mark = temp.path("merged.goblin.partial.job");
    let own = fs::read(&mark).unwrap();
    // Without a mark, or with another job's: nothing is overwritten.
    fs::remove_file(&mark).unwrap();
    fs::write(&partial, &bytes).unwrap();
    assert!(complaint(&merge, 1).contains("another merge"));
    fs::write(&mark, "0".repeat(32)).unwrap();
    assert!(complaint(&merge, 1).contains("another merge") && fs::read(&partial).unwrap() == bytes);
    fs::write(&mark, own).unwrap();
    // Corrupt, or too short.
    bytes[start + first.len() / 2] ^= 1;
    fs::write(&partial, &bytes).unwrap();
    let message = complaint(&merge, 1);
    assert!(message.contains("merged.goblin.partial") && message.contains("segment"), "{message}");
    fs::write(&partial, &whole[..end - 1]).unwrap();
    assert!(complaint(&merge, 1).contains("build the shard again"));
    bytes[start + first.len() / 2] ^= 1;
    fs::write(&partial, &bytes).unwrap();
    // Rebuilding one of them loses nothing.
    spinney(&["-q", "shard", "build", &job, "1"]).success();
    spinney(&merge).success();
    assert!(fs::read(&merged).unwrap() == whole);
    assert!(!temp.path("job").exists());
}

#[test]
fn streams_and_two_at_once_are_refused() {
    let temp = TestDirectory::new();
    let (job, _) = job(&temp, "2");
    let missing =
        complaint(&["shard", "merge", &job, "-o", &temp.name("merged.goblin"), "--remove-shards"], 1);
    assert!(
        missing.contains("0 to 1 are missing") && !temp.path("merged.goblin.partial").exists(),
        "{missing}"
    );
    build_all(&job, 2);
    let stream = complaint(&["shard", "merge", &job, "-o", "-", "--remove-shards"], 1);
    assert!(stream.contains("stream"), "{stream}");
    let partial = fs::File::create(temp.path("merged.goblin.partial")).unwrap();
    partial.lock().unwrap();
    (&partial).write_all(b"x").unwrap();
    let locked =
        complaint(&["shard", "merge", &job, "-o", &temp.name("merged.goblin"), "--remove-shards"], 1);
    assert!(locked.contains("another process"), "{locked}");
    assert_eq!(temp.leftovers("job/shards"), Vec::<String>::new());
    assert!(run_bytes(&temp) > 0);
}

/// A merge killed after its rename, at any moment of the job's removal: the same command succeeds
/// and cleans up.
#[test]
fn merges_cut_off_after_writing_the_file_are_resumed() {
    let temp = TestDirectory::new();
    let (job, whole) = job(&temp, "3");
    build_all(&job, 3);
    let merged = temp.name("merged.goblin");
    let merge = ["-q", "shard", "merge", &job, "-o", &merged, "--remove-shards"];
    let files = || -> Vec<_> {
        let mut all: Vec<_> =
            fs::read_dir(temp.path("job/shards")).unwrap().map(|file| file.unwrap().path()).collect();
        all.sort();
        all.extend([temp.path("job/head.goblin"), temp.path("job/plan.json")]);
        all
    };
    let saved: Vec<_> = files().into_iter().map(|path| (fs::read(&path).unwrap(), path)).collect();
    let id = {
        // The mark of a merge that lacks a shard contains the job.
        let (bytes, path) = saved.iter().find(|(_, path)| path.ends_with("0001-0.run")).unwrap();
        fs::remove_file(path).unwrap();
        complaint(&merge, 1);
        fs::write(path, bytes).unwrap();
        fs::read_to_string(temp.path("merged.goblin.partial.job")).unwrap()
    };
    let mark = {
        let mut output = Output::create(&temp.path("merged.goblin")).unwrap();
        let path = temp.path("mark");
        output.record_completion(CompletionRecord { path: path.clone(), work: id });
        output.write_all(&whole).unwrap();
        output.commit().unwrap();
        let mark = fs::read(&path).unwrap();
        fs::remove_file(path).unwrap();
        mark
    };
    for gone in 0..=saved.len() {
        let _ = fs::remove_file(temp.path("merged.goblin.partial"));
        fs::create_dir_all(temp.path("job/shards")).unwrap();
        for (bytes, path) in &saved {
            fs::write(path, bytes).unwrap();
        }
        saved[..gone].iter().for_each(|(_, path)| fs::remove_file(path).unwrap());
        fs::write(&merged, &whole).unwrap();
        fs::write(temp.path("merged.goblin.partial.job"), &mark).unwrap();
        spinney(&merge).success();
        assert!(fs::read(&merged).unwrap() == whole);
        assert_eq!(temp.leftovers("."), ["merged.goblin", "p.tif", "whole.goblin"], "{gone} files were gone");
    }
    // Everything was done except the report.
    let message = stderr(spinney(&merge).success());
    assert!(message.contains("no such job"), "{message}");
    // Without the file, or with a different one, shards stay.
    fs::create_dir_all(temp.path("job/shards")).unwrap();
    saved.iter().for_each(|(bytes, path)| fs::write(path, bytes).unwrap());
    fs::write(temp.path("merged.goblin.partial.job"), &mark).unwrap();
    fs::copy(temp.path("p.tif"), &merged).unwrap();
    spinney(&merge).success();
    assert!(fs::read(&merged).unwrap() == whole);
    assert!(
        complaint(&["-q", "shard", "merge", &job, "-o", &temp.name("none.goblin"), "--remove-shards"], 1)
            .contains("job")
    );
}

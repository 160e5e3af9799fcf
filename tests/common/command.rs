//! Running the `spinney` program.

use std::path::PathBuf;
use std::process::Child;
use std::time::Duration;
use std::{fs, thread};

use assert_cmd::Command;
use assert_cmd::assert::Assert;

pub fn spinney(arguments: &[&str]) -> Assert {
    Command::cargo_bin("spinney").unwrap().args(arguments).assert()
}

/// What a run that succeeds prints.
pub fn stdout(arguments: &[&str]) -> String {
    String::from_utf8(spinney(arguments).success().get_output().stdout.clone()).unwrap()
}

pub fn stderr(assert: Assert) -> String {
    String::from_utf8(assert.get_output().stderr.clone()).unwrap()
}

/// The most memory that a process ever had, in bytes, as seen shortly before its end.
#[cfg(target_os = "linux")]
pub fn peak_memory(child: &mut Child) -> u64 {
    let status = PathBuf::from(format!("/proc/{}/status", child.id()));
    let mut peak = 0;
    while child.try_wait().unwrap().is_none() {
        let text = fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kib = line.and_then(|line| line.trim().strip_suffix(" kB")?.parse::<u64>().ok());
        peak = peak.max(kib.unwrap_or(0) * 1024);
        thread::sleep(Duration::from_millis(2));
    }
    assert!(child.wait().unwrap().success());
    peak
}

//! Running the `spinney` program.

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

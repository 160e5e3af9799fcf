//! Runs the `spinney` program.

use std::path::PathBuf;
use std::process::Child;
use std::time::Duration;
use std::{fs, thread};

use assert_cmd::Command;
use assert_cmd::assert::Assert;

/// Returns the command for the program with arguments, not yet started.
pub fn command(arguments: &[&str]) -> Command {
    let mut command = Command::cargo_bin("spinney").unwrap();
    command.args(arguments);
    command
}

/// Runs the program.
pub fn spinney(arguments: &[&str]) -> Assert {
    command(arguments).assert()
}

/// Returns the standard output of a run that succeeds.
pub fn stdout(arguments: &[&str]) -> String {
    String::from_utf8(spinney(arguments).success().get_output().stdout.clone()).unwrap()
}

pub fn stderr(assert: Assert) -> String {
    String::from_utf8(assert.get_output().stderr.clone()).unwrap()
}

/// Returns the error message of a run that fails with an exit code and without a panic.
pub fn complaint(arguments: &[&str], code: i32) -> String {
    let text = stderr(spinney(arguments).code(code));
    assert!(!text.contains("panicked") && !text.is_empty(), "{text}");
    text
}

/// Starts a program with default handlers for the signals that end it.
const WITH_DEFAULT_SIGNALS: &str = "import os, signal, sys
for name in ('SIGINT', 'SIGTERM', 'SIGHUP', 'SIGPIPE', 'SIGXFSZ'):
    signal.signal(getattr(signal, name), signal.SIG_DFL)
os.execvp(sys.argv[1], sys.argv[1:])
";

/// Returns a command that SIGINT, SIGTERM and SIGHUP can end; `None` if no launcher works.
///
/// Signals that the parent of these tests ignores (a shell does so for background programs) are
/// ignored by the tests and by every child process. A shell cannot restore them, but other programs
/// can.
#[cfg(unix)]
pub fn interruptible(program: &str) -> Option<std::process::Command> {
    use std::os::unix::process::ExitStatusExt;
    let launchers: [&[&str]; 3] =
        [&[], &["env", "--default-signal=INT,TERM,HUP"], &["python3", "-c", WITH_DEFAULT_SIGNALS]];
    let launch = |launcher: &[&str], program: &str| match launcher {
        [] => std::process::Command::new(program),
        [first, rest @ ..] => {
            let mut command = std::process::Command::new(first);
            command.args(rest).arg(program);
            command
        }
    };
    // A shell that sends itself a signal exits with success only if the signal is ignored.
    let works = |launcher: &&&[&str]| {
        ["INT", "TERM", "HUP"].into_iter().all(|name| {
            let mut shell = launch(launcher, "sh");
            shell.args(["-c", "kill -s \"$0\" $$", name]).stderr(std::process::Stdio::null());
            shell.status().is_ok_and(|status| status.signal().is_some())
        })
    };
    let launcher = launchers.iter().find(works);
    if launcher.is_none() {
        println!("skipped: the parent process ignores signals, and tests cannot change that");
    }
    launcher.map(|launcher| launch(launcher, program))
}

/// Returns the peak memory of a process in bytes, sampled until shortly before it exits.
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

/// Runs a test, given by its module path, in its own process so that its memory can be measured.
/// Returns whether this is that process.
pub fn is_alone(test: &str) -> bool {
    const ALONE: &str = "SPINNEY_TEST_ALONE";
    if std::env::var_os(ALONE).is_some() {
        return true;
    }
    let mut command = std::process::Command::new(std::env::current_exe().unwrap());
    let run = command.args([test, "--exact", "--nocapture"]).env(ALONE, "").output().unwrap();
    let say = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let said = say(&run.stdout);
    assert!(run.status.success() && said.contains("1 passed"), "{said}{}", say(&run.stderr));
    false
}

/// Returns this process's peak memory in bytes; 0 if the system does not report it.
pub fn own_peak_memory() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB"));
    peak.and_then(|kilobytes| kilobytes.parse::<u64>().ok()).unwrap_or(0) << 10
}

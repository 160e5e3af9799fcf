//! Closed standard output: a write to it must fail, not be lost silently.
//!
//! The standard library opens `/dev/null` for a closed standard stream before `main`, and ignores
//! errors of closed streams. So the program checks before that, and opens a device that reports
//! errors.

use std::sync::atomic::{AtomicBool, Ordering};

static WAS_CLOSED: AtomicBool = AtomicBool::new(false);

/// Checks whether standard output is open.
#[cfg(target_os = "linux")]
extern "C" fn check_stdout() {
    let is_closed = rustix::io::fcntl_getfd(rustix::stdio::stdout()).is_err();
    WAS_CLOSED.store(is_closed, Ordering::Relaxed);
}

/// A function that the system calls before the standard library is initialized.
// SAFETY: this section must have a function that needs no later initialization of the standard
// library. This one makes one system call and sets a flag.
#[cfg(target_os = "linux")]
#[allow(unsafe_code)]
#[used]
#[unsafe(link_section = ".init_array")]
static CHECK_STDOUT: extern "C" fn() = check_stdout;

/// Whether standard output was closed when the program was started.
pub(crate) fn stdout_was_closed() -> bool {
    WAS_CLOSED.load(Ordering::Relaxed)
}

/// Makes writes to a closed standard output fail.
pub(crate) fn refuse_closed_stdout() {
    #[cfg(target_os = "linux")]
    if stdout_was_closed()
        && let Ok(full) = std::fs::File::options().write(true).open("/dev/full")
    {
        let _ = rustix::stdio::dup2_stdout(full);
    }
}

//! Standard output that is closed: what is written to it must not vanish without a word.
//!
//! The standard library opens `/dev/null` in the place of a closed standard stream before `main`, and ignores errors
//! that say that one is closed. So the program looks before that, and puts something there whose errors count.

use std::sync::atomic::{AtomicBool, Ordering};

static WAS_CLOSED: AtomicBool = AtomicBool::new(false);

/// Looks whether standard output is open.
#[cfg(target_os = "linux")]
extern "C" fn look() {
    let is_closed = rustix::io::fcntl_getfd(rustix::stdio::stdout()).is_err();
    WAS_CLOSED.store(is_closed, Ordering::Relaxed);
}

/// The function that the system calls before the standard library is at work.
// SAFETY: what stands in this section must be a function that needs nothing of the standard library that is set up
// later; this one makes one system call and sets a number.
#[cfg(target_os = "linux")]
#[allow(unsafe_code)]
#[used]
#[unsafe(link_section = ".init_array")]
static LOOK: extern "C" fn() = look;

/// Whether standard output was closed when the program was started.
pub(crate) fn stdout_was_closed() -> bool {
    WAS_CLOSED.load(Ordering::Relaxed)
}

/// Makes writing to a standard output that was closed an error.
pub(crate) fn refuse_closed_stdout() {
    #[cfg(target_os = "linux")]
    if stdout_was_closed()
        && let Ok(full) = std::fs::File::options().write(true).open("/dev/full")
    {
        let _ = rustix::stdio::dup2_stdout(full);
    }
}

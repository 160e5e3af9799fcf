//! Signals: cancel the program cleanly. Signals that the parent process ignores have no effect.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock};

use signal_hook::consts::{SIGINT, SIGTERM};

/// Whether the user has cancelled the program. (Signals reach the process, not a single operation.)
static STOP: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);

/// Whether the user has cancelled the program.
pub(crate) fn stop_is_wanted() -> bool {
    STOP.load(Ordering::Relaxed)
}

/// Handles interrupt, termination and hangup signals: the first one cancels the work, the second
/// one ends the program at once. Neither leaves unfinished files.
///
/// Call this before creating anything that an aborted program would leave.
pub(crate) fn stop_in_good_order() -> io::Result<()> {
    static STARTED: AtomicBool = AtomicBool::new(false);
    if STARTED.swap(true, Ordering::Relaxed) { Ok(()) } else { heed_signals() }
}

/// Systems without SIGHUP: every signal only sets the flag.
#[cfg(not(unix))]
fn heed_signals() -> io::Result<()> {
    [SIGINT, SIGTERM]
        .into_iter()
        .try_for_each(|signal| signal_hook::flag::register(signal, STOP.clone()).map(|_| ()))
}

#[cfg(unix)]
fn heed_signals() -> io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGXFSZ};
    // Check each signal on its own: shells ignore INT for background programs, `nohup` ignores HUP.
    let ignored = ignored_signals();
    let heeded = [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0);
    let mut signals = signal_hook::iterator::Signals::new(heeded)?;
    std::thread::spawn(move || {
        for _ in signals.forever() {
            if STOP.swap(true, Ordering::Relaxed) {
                spinney::Output::remove_unfinished();
                std::process::exit(super::report::exit::INTERRUPTED.into());
            }
        }
    });
    // With any handler, a write beyond the file size limit fails with an error, as on a full disk.
    // The default action of SIGXFSZ ends the program.
    signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)))?;
    Ok(())
}

/// Returns the signals that the parent process ignores, as bits, from signal 1 on.
#[cfg(unix)]
fn ignored_signals() -> u64 {
    // (Only Linux has this file. On other systems no signal counts as ignored.)
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}

/// Error message for a page of a mapping that cannot be read.
#[cfg(unix)]
const LOST_PAGE: &[u8] =
    b"spinney: a mapped file was truncated, or its disk failed, while it was read; --positioned reads such files \
without mapping them\n";

/// Prints the message and ends the program.
#[cfg(unix)]
extern "C" fn page_is_lost(_: libc::c_int) {
    let _ = rustix::io::write(rustix::stdio::stderr(), LOST_PAGE);
    // SAFETY: `_exit` is async-signal-safe, and does not return.
    #[allow(unsafe_code)]
    unsafe {
        libc::_exit(1)
    }
}

/// Handles lost pages of a mapped file (SIGBUS): prints an error and exits instead of crashing.
///
/// The standard library's handler restores the default action unless the signal is a stack
/// overflow. A handler chained to it would thus run only once, and the signal would then be fatal
/// to other threads. So this handler replaces it.
pub(crate) fn report_lost_pages() {
    #[cfg(unix)]
    // SAFETY: the handler may run at any read of a mapped file. It makes two async-signal-safe
    // system calls, and never returns. Zero is valid for all other fields of the action, and means
    // no flag and no signal mask.
    #[allow(unsafe_code)]
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        action.sa_sigaction = page_is_lost as extern "C" fn(libc::c_int) as usize;
        action.sa_flags = libc::SA_ONSTACK;
        libc::sigaction(libc::SIGBUS, &action, std::ptr::null_mut());
    }
}

//! Signals: an end in good order, or none where whoever started the program wants them ignored.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock};

use signal_hook::consts::{SIGINT, SIGTERM};

/// Whether the user wants the program to stop. (A signal reaches the process, not a piece of work.)
static STOP: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);

/// Whether the user wants the program to stop.
pub(crate) fn stop_is_wanted() -> bool {
    STOP.load(Ordering::Relaxed)
}

/// Makes the first interruption, termination or end of the session a wish to stop, and a second one the end of
/// the program at once. Neither leaves unfinished files behind.
///
/// To be called before anything is created that an interrupted program would leave behind.
pub(crate) fn stop_in_good_order() -> io::Result<()> {
    static STARTED: AtomicBool = AtomicBool::new(false);
    if STARTED.swap(true, Ordering::Relaxed) { Ok(()) } else { heed_signals() }
}

/// Where there are two signals of this kind, all of them are wishes.
#[cfg(not(unix))]
fn heed_signals() -> io::Result<()> {
    [SIGINT, SIGTERM]
        .into_iter()
        .try_for_each(|signal| signal_hook::flag::register(signal, STOP.clone()).map(|_| ()))
}

#[cfg(unix)]
fn heed_signals() -> io::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGXFSZ};
    // Each by itself: a program in the background of a shell has INT ignored, and under `nohup` HUP.
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
    // A handler, whatever it does, makes writing beyond the largest size of files an error like a full disk; by
    // default the program would end there and then.
    signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)))?;
    Ok(())
}

/// Signals that whoever started the program wants ignored, bit by bit from signal 1 on.
#[cfg(unix)]
fn ignored_signals() -> u64 {
    // (Elsewhere than on Linux there is no such file, and nothing counts as ignored.)
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}

/// Last words where a mapped page is not there any more.
#[cfg(unix)]
const LOST_PAGE: &[u8] =
    b"spinney: a file was cut short, or its disk failed, while it was read; --positioned reads such files \
without mapping them\n";

/// Ends the program where a page is not there.
#[cfg(unix)]
extern "C" fn page_is_lost(_: libc::c_int) {
    let _ = rustix::io::write(rustix::stdio::stderr(), LOST_PAGE);
    // SAFETY: may be called anywhere, and does not return.
    #[allow(unsafe_code)]
    unsafe {
        libc::_exit(1)
    }
}

/// Makes a page of a mapped file that is not there any more (SIGBUS) a message and an exit code, instead of a
/// crash.
///
/// The standard library has a handler, too, and whoever is called beside it is called once only, after which the
/// signal is deadly to other threads: this one takes its place.
pub(crate) fn tell_lost_pages() {
    #[cfg(unix)]
    // SAFETY: the handler runs where a page of a mapped file was read, amid anything; it makes two system calls
    // that may be made there, and never returns. All that is not set of the action is zero, which means nothing.
    #[allow(unsafe_code)]
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        action.sa_sigaction = page_is_lost as extern "C" fn(libc::c_int) as usize;
        action.sa_flags = libc::SA_ONSTACK;
        libc::sigaction(libc::SIGBUS, &action, std::ptr::null_mut());
    }
}

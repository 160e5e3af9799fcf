//! Exit codes, which follow the shells' customs on every system.

use std::io;

use spinney::Error;

/// Exit code of a program that was interrupted.
pub(crate) const INTERRUPTED: u8 = 130;

/// Code that a shell reports of a program that wrote to a closed pipe: no failure to complain about.
pub(crate) const BROKEN_PIPE: u8 = 141;

/// Exit code of a program that failed.
pub(crate) fn exit_code(error: &anyhow::Error) -> u8 {
    let is_broken_pipe = |error: &io::Error| error.kind() == io::ErrorKind::BrokenPipe;
    match error.downcast_ref() {
        Some(Error::Interrupted) => INTERRUPTED,
        Some(Error::Io { cause, .. }) if is_broken_pipe(cause) => BROKEN_PIPE,
        _ if error.downcast_ref().is_some_and(is_broken_pipe) => BROKEN_PIPE,
        _ => 1,
    }
}

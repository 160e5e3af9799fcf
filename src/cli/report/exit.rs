//! Exit codes, which follow the shells' conventions on every system.

use std::io;

use spinney::Error;

/// Exit code of a cancelled program.
pub(crate) const INTERRUPTED: u8 = 130;

/// Exit code for a write to a closed pipe, as shells report it. The program prints no error then.
pub(crate) const BROKEN_PIPE: u8 = 141;

/// Returns the exit code for an error.
pub(crate) fn exit_code(error: &anyhow::Error) -> u8 {
    let is_broken_pipe = |error: &io::Error| error.kind() == io::ErrorKind::BrokenPipe;
    match error.downcast_ref() {
        Some(Error::Interrupted) => INTERRUPTED,
        Some(Error::Io { cause, .. }) if is_broken_pipe(cause) => BROKEN_PIPE,
        _ if error.downcast_ref().is_some_and(is_broken_pipe) => BROKEN_PIPE,
        _ => 1,
    }
}

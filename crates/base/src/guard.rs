//! Protection from decoders that panic.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use crate::{Error, Result};

/// Runs a decoder of another crate on unchecked bytes, and turns a panic into an error.
///
/// Such decoders use asserts, `expect` and (in debug builds) overflow checks for states that they
/// consider impossible. Untrusted files reach such states now and then. The user must then get an
/// error message, not an abort of the process.
///
/// # Errors
/// Those of the decoder; [`Error::Corrupt`] if it panics. `location` describes the position in the
/// file.
pub fn guard<T>(path: &Path, location: &str, decode: impl FnOnce() -> Result<T>) -> Result<T> {
    // A decoder that has panicked is in an unknown state, but it is not used again: the error ends
    // the read.
    catch_unwind(AssertUnwindSafe(decode)).unwrap_or_else(|_| Err(broken(path, location)))
}

#[cold]
fn broken(path: &Path, location: &str) -> Error {
    Error::corrupt(path, location, "bytes on which the decoder fails", "a valid file")
}

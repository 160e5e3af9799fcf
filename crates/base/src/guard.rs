//! Protection from decoders that panic.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use crate::{Error, Result};

/// Runs a decoder of another crate on bytes that nobody has checked. Such crates use asserts, `expect` and
/// (in debug builds) overflow checks for what they take to be impossible; hostile files prove them wrong now
/// and then, and that must cost the user an error message, not the process.
pub fn guard<T>(path: &Path, place: &str, decode: impl FnOnce() -> Result<T>) -> Result<T> {
    // A decoder that panicked is in an unknown state, but is never used again: the error ends the reading.
    catch_unwind(AssertUnwindSafe(decode)).unwrap_or_else(|_| Err(broken(path, place)))
}

#[cold]
fn broken(path: &Path, place: &str) -> Error {
    Error::corrupt(path, place, "bytes that break the decoder", "a valid file")
}

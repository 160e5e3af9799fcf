//! Progress of long work, and its interruption.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use crate::{Error, Result};

/// Receives the progress of long work. All methods may be called from any thread.
pub trait Progress: Sync {
    /// Reports the work (cells, for a build) that was done since the last call, and the total.
    fn advance(&self, done: u64, total: u64) {
        let _ = (done, total);
    }

    /// Tells something about a file that is no failure, but should be known to whoever works with it.
    fn warn(&self, file: &Path, text: &str) {
        let _ = (file, text);
    }

    /// Whether the work should stop as soon as possible.
    fn interrupted(&self) -> bool {
        false
    }

    /// Fails with [`Error::Interrupted`] if the work should stop.
    fn check(&self) -> Result<()> {
        if self.interrupted() { Err(Error::Interrupted) } else { Ok(()) }
    }
}

/// No progress wanted.
impl Progress for () {}

/// Progress of a part of the work that counts other units: it forwards warnings and cancellation, and does not advance the whole.
pub struct SilentProgress<'a>(pub &'a dyn Progress);

impl Progress for SilentProgress<'_> {
    fn warn(&self, file: &Path, text: &str) {
        self.0.warn(file, text);
    }

    fn interrupted(&self) -> bool {
        self.0.interrupted()
    }
}

/// Progress of one of several parts of long work, each of which counts units of its own: the part advances the whole by `share` of
/// `total` units.
pub struct SubProgress<'a> {
    whole: &'a dyn Progress,
    share: u64,
    total: u64,
    /// Units of the part that are done.
    done: Mutex<u64>,
}

impl<'a> SubProgress<'a> {
    /// A part that has `share` of `total` units.
    pub fn new(whole: &'a dyn Progress, share: u64, total: u64) -> SubProgress<'a> {
        SubProgress { whole, share, total, done: Mutex::new(0) }
    }
}

impl Progress for SubProgress<'_> {
    fn advance(&self, done: u64, total: u64) {
        let mut before = self.done.lock().unwrap_or_else(PoisonError::into_inner);
        let scaled = |units: u64| {
            (u128::from(units.min(total)) * u128::from(self.share) / u128::from(total.max(1))) as u64
        };
        let after = before.saturating_add(done);
        self.whole.advance(scaled(after).saturating_sub(scaled(*before)), self.total);
        *before = after;
    }

    fn warn(&self, file: &Path, text: &str) {
        self.whole.warn(file, text);
    }

    fn interrupted(&self) -> bool {
        self.whole.interrupted()
    }
}

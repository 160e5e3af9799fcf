//! Progress and cancellation of long operations.

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use crate::{Error, Result};

/// Receives the progress of long operations. All methods may be called from any thread.
pub trait Progress: Sync {
    /// Reports the units (cells, for a build) that were completed since the last call, and the
    /// total.
    fn advance(&self, done: u64, total: u64) {
        let _ = (done, total);
    }

    /// Reports a condition of a file that is no failure, but that its user should know.
    fn warn(&self, file: &Path, text: &str) {
        let _ = (file, text);
    }

    /// Whether the operation should stop as soon as possible.
    fn interrupted(&self) -> bool {
        false
    }

    /// Fails if the operation should stop.
    ///
    /// # Errors
    /// [`Error::Interrupted`] after cancellation.
    fn check(&self) -> Result<()> {
        if self.interrupted() { Err(Error::Interrupted) } else { Ok(()) }
    }
}

/// Ignores progress, and never cancels.
impl Progress for () {}

/// Progress of a suboperation that counts other units.
///
/// It forwards warnings and cancellation, but does not advance the whole operation.
pub struct SilentProgress<'a>(pub &'a dyn Progress);

impl Progress for SilentProgress<'_> {
    fn warn(&self, file: &Path, text: &str) {
        self.0.warn(file, text);
    }

    fn interrupted(&self) -> bool {
        self.0.interrupted()
    }
}

/// Progress of one of several suboperations that each count their own units.
///
/// A complete suboperation advances the whole operation by `share` of `total` units.
pub struct SubProgress<'a> {
    whole: &'a dyn Progress,
    share: u64,
    total: u64,
    /// Completed units of the suboperation.
    done: Mutex<u64>,
}

impl<'a> SubProgress<'a> {
    /// Creates the progress of a suboperation that accounts for `share` of `total` units.
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

//! Progress of long work, and its interruption.

use std::path::Path;

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

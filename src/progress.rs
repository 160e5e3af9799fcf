//! Progress of long work, and its interruption.

use crate::{Error, Result};

/// Receives the progress of long work. All methods may be called from any thread.
pub trait Progress: Sync {
    /// Reports the work (cells, for a build) that was done since the last call, and the total.
    fn advance(&self, done: u64, total: u64) {
        let _ = (done, total);
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

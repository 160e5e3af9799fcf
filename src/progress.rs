//! How long work tells how far it is, and hears that it should stop.

use crate::{Error, Result};

/// Receives the progress of long work. All methods may be called from any thread.
pub trait Progress: Sync {
    /// So much work (cells, for a build) was done since the last call, of so much in total.
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

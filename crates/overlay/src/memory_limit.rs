//! Memory limit and cancellation of an overlay.

use std::path::Path;

use spinney_base::{Error, Progress, Result};

/// Estimated memory per edge in bytes, including its ends and all derived data. Each crossing and
/// each passage adds an edge.
pub(crate) const BYTES_OF_EDGE: u64 = 320;

/// Number of squares between two checks for cancellation.
pub(crate) const SQUARES_PER_CHECK: u64 = 1 << 12;

/// A memory limit, and the number of edges that count against it.
pub(crate) struct MemoryLimit<'a> {
    /// A file that polygons come from, for error messages.
    pub(crate) path: &'a Path,
    pub(crate) memory: u64,
    pub(crate) edges: u64,
    pub(crate) progress: &'a dyn Progress,
}

impl MemoryLimit<'_> {
    /// Checks that the edges, split at `split_points` points, fit into the memory limit. Also
    /// checks for cancellation.
    pub(crate) fn check(&self, split_points: usize) -> Result<()> {
        self.progress.check()?;
        let needed = (self.edges + split_points as u64) * BYTES_OF_EDGE;
        if needed <= self.memory {
            return Ok(());
        }
        let what = match split_points {
            0 => format!("an overlay of {} edges", self.edges),
            _ => {
                format!("an overlay of {} edges that are split at {split_points} points or more", self.edges)
            }
        };
        let (path, limit) = (self.path.into(), self.memory);
        Err(Error::TooLarge {
            path,
            what,
            needed,
            limit,
            advice: "raise --memory, or divide the polygons".into(),
        })
    }
}

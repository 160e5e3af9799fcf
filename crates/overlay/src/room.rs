//! Room in memory for what is found on the way, and whether the work is to go on.

use std::path::Path;

use spinney_base::{Error, Progress, Result};

/// Bytes of memory that an edge takes, with its ends, and all that is made of it. A crossing and a passage make edges of their own.
pub(crate) const BYTES_OF_EDGE: u64 = 320;

/// Squares of a walk from one look at whether the work is to go on to the next.
pub(crate) const SQUARES_BETWEEN_LOOKS: u64 = 1 << 12;

/// The memory that there may be, and how much of it is taken by edges.
pub(crate) struct Room<'a> {
    /// A file that polygons come from, for messages.
    pub(crate) path: &'a Path,
    pub(crate) memory: u64,
    pub(crate) edges: u64,
    pub(crate) progress: &'a dyn Progress,
}

impl Room<'_> {
    /// Checks that there is room for places where edges are divided.
    pub(crate) fn check(&self, places: usize) -> Result<()> {
        self.progress.check()?;
        let needed = (self.edges + places as u64) * BYTES_OF_EDGE;
        if needed <= self.memory {
            return Ok(());
        }
        let what = match places {
            0 => format!("an overlay of {} edges", self.edges),
            _ => format!("an overlay of {} edges that are divided in {places} places or more", self.edges),
        };
        let (path, limit) = (self.path.into(), self.memory);
        Err(Error::TooLarge {
            path,
            what,
            needed,
            limit,
            advice: "allow more, or divide the polygons".into(),
        })
    }
}

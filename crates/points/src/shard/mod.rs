//! Sharded point trees. A *shard* is a range of space that is built independently, perhaps by
//! another process. Merging the shards yields the same file as a single-process build.
//!
//! Space is divided at the nodes of one level, the *units*, which is no deeper than the sampling
//! cells of the root. The first point of a unit thus goes to the root, whatever precedes it, and
//! the levels of all other points depend only on the unit's points ([`node_level`](crate::build)).
//! Nodes below units are final and go to a *run file*. A [*shard
//! summary*](spinney_container::ShardSummary) holds the rest: points of nodes above units, points
//! of units too small to be nodes, and the statistics of blocks and nodes. The nodes above units
//! are built from it.

mod build;
mod cut;
mod merge;
mod packed_rows;
#[cfg(test)]
mod tests;
mod units;
mod writer;

use crate::build::levels_below;
use crate::grid::{PointGrid, spacing_levels};
use spinney_base::space::{Code, CodeRange, Dimension};
use spinney_container::Shard;

pub use build::{build_empty_shard, build_shard, write_head};
pub use cut::{PointCut, cut};
pub use merge::merge_shards;
pub use units::find_shard;

/// Shard of a point tree.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PointShard {
    /// Its files, and its run of units as the only entry of `ranges` (layer 0), which is empty if
    /// the shard has no units.
    pub shard: Shard,
    /// Level of the units.
    pub level: u8,
}

impl PointShard {
    /// Returns the code range of its units.
    fn run(&self) -> Option<CodeRange> {
        self.shard.ranges.first().map(|range| range.run)
    }
}

/// Returns the deepest possible level of units.
fn deepest_units(grid: &PointGrid) -> u8 {
    // Bucket nodes must not be above units.
    spacing_levels(grid.dimension).min(levels_below(grid.dimension)).min(grid.deepest())
}

/// Returns the unit that contains a code, given as bits.
fn unit_of(dimension: Dimension, level: u8, bits: u64) -> Code {
    let path = bits >> (63 - dimension.axes() as u32 * u32::from(level));
    Code::from_path(dimension, level, path).expect("a number of a code has a unit")
}

/// Returns the sort key of postorder.
fn postorder(code: Code) -> (u64, std::cmp::Reverse<u8>) {
    (code.last_bits(), std::cmp::Reverse(code.level()))
}

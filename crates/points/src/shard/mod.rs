//! Trees of points in *shards*: parts of the space that are built by themselves, perhaps by many processes, and are put together to the file that
//! would have been built in one go.
//!
//! The space is cut at nodes of one level, *units*, which is no deeper than the spacing of the root's points: so the first point of a unit
//! goes to the root, whatever came before it, and where all others go is told by the unit's points alone ([`node_level`](crate::build)). What is
//! below units is final, and goes to a *run file*. Points that go to nodes above, points of units that are too few to be nodes by themselves, and what is known of
//! blocks and nodes go to a [*shard summary*](spinney_container::ShardSummary), of which the nodes above are made.

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
use spinney_base::space::{Code, CodeRun, Dimension};
use spinney_container::Shard;

pub use build::{build_empty_shard, build_shard, write_head};
pub use cut::{PointCut, cut};
pub use merge::merge_shards;
pub use units::find_shard;

/// A shard of a tree of points.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PointShard {
    /// Its files, and its run of units as the piece of layer 0; no piece if the shard has no units.
    pub shard: Shard,
    /// The level of units.
    pub level: u8,
}

impl PointShard {
    /// The codes of its units.
    fn run(&self) -> Option<CodeRun> {
        self.shard.pieces.first().map(|piece| piece.run)
    }
}

/// The deepest level of units.
fn deepest_units(grid: &PointGrid) -> u8 {
    // (Rows are put by nodes that are not above units.)
    spacing_levels(grid.dimension).min(levels_below(grid.dimension)).min(grid.deepest())
}

/// The unit that has a number of a code.
fn unit_of(dimension: Dimension, level: u8, bits: u64) -> Code {
    let path = bits >> (63 - dimension.axes() as u32 * u32::from(level));
    Code::from_path(dimension, level, path).expect("a number of a code has a unit")
}

/// Place in the order in which nodes end.
fn postorder(code: Code) -> (u64, std::cmp::Reverse<u8>) {
    (code.last_bits(), std::cmp::Reverse(code.level()))
}

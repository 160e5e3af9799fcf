//! Building: points are sorted by their codes, out of core, and each goes into the coarsest node
//! whose spacing it keeps.
//!
//! [`Buckets`](buckets::Buckets) sort roughly, [`Assembler`](assembler::Assembler) forms nodes from
//! sorted points, and [`Encoder`](encoder::Encoder) encodes their points as blocks.

mod assembler;
mod buckets;
mod encoder;
mod order;
mod run;
mod work;

use crate::statistics::Statistics;
use spinney_base::Result;
use spinney_base::space::Code;

pub(crate) use assembler::{Assembled, Assembler, Closed, Pending, write_items, write_root};
pub(crate) use buckets::{BucketedRows, Buckets, levels_below};
pub(crate) use encoder::Encoder;
pub(crate) use run::{BATCH, encoder_of};
pub use run::{BuildSummary, PointBuildOptions, build};
pub(crate) use work::{Plan, Work};

/// Destination of finished blocks and nodes, in postorder.
pub(crate) trait NodeSink {
    /// Takes a block of a node.
    fn block(&mut self, code: Code, bytes: &[u8], statistics: &Statistics) -> Result<()>;

    /// Takes a node, with statistics of all points in it and below.
    fn node(&mut self, code: Code, statistics: &Statistics) -> Result<()>;
}

/// Bytes of the input number that follows each row.
pub(crate) const NUMBER_BYTES: usize = 5;
/// Maximum number of points that input numbers can distinguish.
pub(crate) const MAX_NUMBERS: u64 = 1 << (8 * NUMBER_BYTES);

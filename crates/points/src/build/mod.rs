//! Building: points are put in order by their codes, beyond memory, and each goes into the coarsest node whose spacing it keeps.
//!
//! [`Buckets`](buckets::Buckets) sort roughly, [`Assembler`](assembler::Assembler) makes nodes of what comes in order, [`Encoder`](encoder::Encoder) makes blocks of bytes of
//! their points.

mod assembler;
mod buckets;
mod encoder;
mod order;
mod run;
mod work;

use crate::statistics::Statistics;
use spinney_base::Result;
use spinney_base::space::Code;

pub(crate) use assembler::{Assembled, Assembler, Closed, Pending, write_pieces, write_root};
pub(crate) use buckets::{BucketedRows, Buckets, levels_below};
pub(crate) use encoder::Encoder;
pub(crate) use run::{BATCH, encoder_of};
pub use run::{BuildSummary, PointBuildOptions, build};
pub(crate) use work::{Plan, Work};

/// Destination of parts of trees as they come out: blocks and nodes in postorder.
pub(crate) trait PieceSink {
    /// Takes a block of a node.
    fn block(&mut self, code: Code, bytes: &[u8], statistics: &Statistics) -> Result<()>;

    /// Takes a node, with what is known of all points in it and below.
    fn node(&mut self, code: Code, statistics: &Statistics) -> Result<()>;
}

/// Bytes behind each row that tell which point it was of all that came in.
pub(crate) const NUMBER_BYTES: usize = 5;
/// Points that such numbers tell apart.
pub(crate) const MAX_NUMBERS: u64 = 1 << (8 * NUMBER_BYTES);

//! Building: points are put in order by their codes, beyond memory, and each goes into the coarsest node whose spacing it keeps.
//!
//! [`Buckets`](buckets::Buckets) sort roughly, [`Assembler`](assembler::Assembler) makes nodes of what comes in order, [`Encoder`](encoder::Encoder) makes blocks of bytes of
//! their points.

mod assembler;
mod buckets;
mod encoder;
mod order;
mod run;

pub(crate) use encoder::Encoder;
pub use run::{BuildSummary, PointBuildOptions, build};

/// Bytes behind each row that tell which point it was of all that came in.
const NUMBER_BYTES: usize = 5;
/// Points that such numbers tell apart.
const MOST_NUMBERS: u64 = 1 << (8 * NUMBER_BYTES);

//! Segments of trees in few bytes, and back: the packed codec (sections 37 to 41 of formats.md).
//!
//! A segment's nodes are coded level by level, each in the context of the nodes around it, with probabilities that follow what was coded ([`bits`]).
//! Dense blocks of numbers are coded plane by plane ([`planes`]): all children of a plane are predicted from the level above ([`predict`]), with weights
//! that are fitted ([`fit`]), and their errors are coded by tables that are stored ([`tables`], [`symbols`]). What is unpacked is the plain segment, byte for byte. Knows what stands in a segment, and nothing of files.
//!
//! [`Columns`] codes numbers of which somebody else knows what they mean, such as those of exact models; [`pack_numbers`] does so for many numbers that
//! mean the same, such as those of points, and much faster.

mod adaptive;
mod around;
mod bits;
mod blocks;
mod columns;
mod contexts;
mod counts;
mod defaults;
mod errors;
mod fit;
mod fixed_log;
mod fullness;
mod grids;
mod groups;
#[cfg(test)]
mod heavy_tests;
mod lanes;
mod masks;
mod model;
mod nodes;
mod plain;
mod plane_form;
mod plane_kernels;
#[cfg(test)]
mod plane_tests;
mod planes;
mod predict;
mod room;
mod runs;
mod samples;
mod segment;
mod symbols;
mod tables;
#[cfg(test)]
mod tests;
mod tokens;
mod values;
mod vectorized;
mod void_nodes;

pub use columns::Columns;
pub use fixed_log::{LOG_BITS, log2};
pub use room::{PLAIN_BITS, PLAIN_PER_BYTE, may_unpack};
pub use runs::{Run, RunForm, UnpackedRuns, pack_runs, unpack_runs};
pub use segment::{Damage, SegmentForm, pack, unpack};
pub use tokens::{MAX_CONTEXTS, pack_numbers, unpack_numbers};

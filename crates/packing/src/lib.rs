//! Packed codec: lossless compression of tree segments (sections 37 to 41 of formats.md).
//!
//! The nodes of a segment are coded level by level, each in the context of its neighbours, with
//! adaptive probabilities ([`bits`]). Dense blocks of numbers are coded plane by plane
//! ([`planes`]). All children of a plane are predicted from the level above ([`predict`]), with
//! fitted weights ([`fit`]). Their residuals are coded with static tables, stored or default
//! ([`tables`], [`symbols`]). Unpacking yields the plain segment, byte for byte. This crate knows
//! the contents of segments, but not of files.
//!
//! [`Columns`] codes integers whose meaning only the caller knows, such as those of exact models.
//! [`pack_numbers`] codes many integers of the same meaning, such as those of points, and is much
//! faster.

mod adaptive;
mod around;
mod bits;
mod blocks;
mod columns;
mod contexts;
mod counts;
mod defaults;
mod errors;
mod expansion;
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
pub use expansion::{PLAIN_BITS, PLAIN_PER_BYTE, may_unpack};
pub use fixed_log::{LOG_BITS, log2};
pub use runs::{Run, RunForm, UnpackedRuns, pack_runs, unpack_runs};
pub use segment::{Corruption, SegmentForm, pack, unpack};
pub use tokens::{MAX_CONTEXTS, pack_numbers, unpack_numbers};

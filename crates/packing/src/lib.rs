//! Packed codec: lossless compression of tree segments (sections 37 to 41 of formats.md).
//!
//! The nodes of a segment are coded level by level, each in the context of its neighbours
//! ([`nodes`]). Dense blocks of numbers are coded plane by plane ([`planes`]): a plane is the same
//! child of all nodes of a level. It is predicted from the level above and from the earlier planes
//! of its own level ([`predict`]), with fitted weights ([`fit`]). The residuals are coded.
//! Unpacking yields the plain segment, byte for byte. This crate knows the contents of segments,
//! but not of files.
//!
//! [`pack_runs`] packs many short runs of records together, those of an Autumnal extent: each run
//! alone would be too short for probabilities to adapt. [`Columns`] codes integers whose meaning
//! only the caller knows, such as those of exact models. [`pack_numbers`] codes many integers of
//! the same meaning, such as those of points, and is much faster.
//!
//! # Entropy coders
//!
//! Probabilities that adapt after each symbol suit few symbols in many contexts, but are slow: each
//! symbol waits for the one before. So there are three coders:
//!
//! - [`bits`], adaptive (rANS): nodes and [`Columns`]. The context of a symbol depends on those
//!   just before it.
//! - [`symbols`], with the static tables of [`tables`], stored or default (tANS): planes. All
//!   contexts of a plane are known before it starts, so eight samples are decoded at a time.
//! - [`tokens`], with stored static tables (rANS): [`pack_numbers`]. The caller knows all contexts
//!   in advance; numbers have up to 64 bits.
//!
//! # Packed bytes
//!
//! | bytes | model | what |
//! | --- | --- | --- |
//! | 4 | all | checksum (CRC-32C) of the plain segment |
//! | 1 | all | model: names, solid or numbers |
//! | LEB128, twice | numbers | lengths of the next two ranges |
//! | | all | output of [`bits`]: table, nodes, fullness, masks, class counts |
//! | | numbers | header of dense blocks: fractions, weights, steps, tables |
//! | | numbers | streams of dense blocks, up to the end: output of [`symbols`] |
//!
//! The table lists distinct values; solids have fullness; masks are the state bits of dense blocks
//! of numbers. Packed runs have the same layout. Their checksum is that of heights,
//! representatives, records and side bytes. Their output of [`bits`] is: total length, side bytes,
//! table, then run by run the height, the representative, the nodes, fullness and masks.

mod adaptive;
mod around;
mod bits;
mod blocks;
mod columns;
mod contexts;
mod counts;
mod defaults;
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
mod residuals;
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
pub use runs::{RunForm, RunRecords, UnpackedRuns, pack_runs, unpack_runs};
pub use segment::{Corruption, SegmentForm, pack, unpack};
pub use tokens::{MAX_CONTEXTS, pack_numbers, unpack_numbers};

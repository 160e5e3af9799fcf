//! `PMTiles`, version 3: an archive of tiles in one file, from which clients read byte ranges.
//!
//! The order in the file is: header and root directory in the first 16384 bytes, tiles, leaf
//! directories, metadata. So tiles can be written in a stream.

mod directory;
mod header;
mod reader;
mod writer;

pub use reader::Pmtiles;
pub(super) use writer::PmtilesSink;

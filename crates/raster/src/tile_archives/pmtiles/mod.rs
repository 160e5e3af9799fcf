//! `PMTiles`, version 3: an archive of tiles in one file, from which a client reads parts by their offsets.
//!
//! The order of parts is: header and root directory in the first 16384 bytes, tiles, leaf directories, metadata; so that tiles
//! can be written as they come.

mod directory;
mod header;
mod reader;
mod writer;

pub use reader::Pmtiles;
pub(super) use writer::PmtilesSink;

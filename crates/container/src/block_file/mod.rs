//! Block files: trees of points and of lines, whose nodes store each item exactly once.
//!
//! A block file contains, in this order: the header, the blocks, the lists of blocks and nodes, a
//! summary section, the metadata and the trailer.

mod entry;
mod reader;
mod writer;

pub use entry::{BlockEntry, BlockLocation};
pub use reader::BlockFile;
pub use writer::BlockWriter;

/// Tag of the metadata section.
const METADATA: [u8; 4] = *b"META";

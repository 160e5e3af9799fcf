//! Files of blocks, in which what is stored once each lies in nodes of a tree: trees of points and of lines. Behind the header stand blocks, then lists of
//! blocks and nodes, a section that says what there is, metadata and the trailer.

mod entry;
mod reader;
mod writer;

pub use entry::{BlockEntry, BlockLocation};
pub use reader::BlockFile;
pub use writer::BlockWriter;

/// Tag of the metadata.
const METADATA: [u8; 4] = *b"META";

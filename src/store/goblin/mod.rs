//! The Goblin format: published, read-only trees. `formats.md` is its specification.
//!
//! A tree is cut into *segments*, preorder runs of fixed-size records under one node, which are found through
//! a directory sorted by FD code. Building is bottom-up and streaming: blocks of cells become parts of the tree,
//! parts are merged and sealed into segments, segments are appended to the file.

mod assemble;
mod copy;
mod directory;
mod header;
mod metadata;
mod reader;
mod record;
mod segment;
mod shape;
mod sorter;
mod verify;
mod writer;

pub(in crate::store) use assemble::write;
pub(in crate::store) use copy::Copied;
pub use directory::Entry;
pub use header::{Codec, Header};
pub use metadata::Metadata;
pub(crate) use reader::read_header;
pub use reader::{Goblin, Handle, OpenOptions};
pub(in crate::store) use record::LIGHT;
pub use record::{CUT, INNER, LEAF, Layout, Record, VOID};
pub use segment::Segment;
pub(crate) use segment::{child_place, child_places};
pub use shape::Shape;
pub use verify::Finding;

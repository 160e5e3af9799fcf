//! The Goblin format: published, read-only trees. `formats.md` is its specification.
//!
//! A tree is cut into *segments*, preorder runs of fixed-size records under one node, which are found through
//! a directory sorted by FD code. Building is bottom-up and streaming: blocks of cells become parts of the tree,
//! parts are merged and sealed into segments, segments are appended to the file.

mod assemble;
mod averaging;
mod block;
mod build;
mod cells;
mod copy;
mod counts;
mod directory;
mod gather;
mod header;
mod metadata;
mod part;
mod reader;
mod record;
mod segment;
mod shape;
mod sorter;
mod subtree;
mod take;
mod verify;
mod writer;

pub use build::{BuildOptions, build, build_slabs, build_with, depth_for};
pub use cells::{Slab, Slabs};
pub use counts::LevelCounts;
pub use directory::Entry;
pub use header::{Codec, Header};
pub use metadata::Metadata;
pub(crate) use reader::read_header;
pub use reader::{Goblin, Handle, OpenOptions};
pub use record::{CUT, INNER, LEAF, Layout, Record, VOID};
pub use segment::Segment;
pub(crate) use segment::{child_place, child_places};
pub use shape::Shape;
pub(crate) use subtree::{BadSkip, each_leaf};
pub use verify::Finding;

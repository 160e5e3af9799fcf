//! The Goblin format: published, read-only trees. `formats.md` is its specification.
//!
//! A tree is cut into *segments*, preorder runs of fixed-size records under one node, which are found through
//! a directory sorted by FD code. Building is bottom-up and streaming: blocks of cells become parts of the
//! tree, parts are merged and sealed into segments, segments are appended to the file.

mod directory;
mod directory_writer;
mod entry_columns;
mod file_writer;
mod held;
mod index;
mod layer_writer;
mod load;
mod locate;
mod open;
mod packed;
mod pages;
mod reader;
mod segment;
mod segment_builder;
mod segment_copy;
mod segment_sink;
mod shard_merge;
mod shard_writer;
mod sizes;
mod source;
mod summary_items;
mod verify;

pub use directory::Entry;
pub(in crate::store) use file_writer::FileWriter;
pub(crate) use locate::Located;
pub use reader::Goblin;
pub use segment::Segment;
pub use shard_merge::{MergeOutput, merge_shards};
pub(in crate::store) use shard_writer::ShardWriter;
pub use sizes::LevelBytes;
pub use source::GoblinNode;
pub use spinney_container::{Shard, ShardPiece};

//! Trees on disk: the two formats, what they share, and how trees are built.

pub mod autumnal;
pub mod builder;
pub mod goblin;
pub mod records;
#[cfg(test)]
mod shard_tests;
mod tree_target;
mod tree_writer;
mod write;

pub use builder::{BuildOptions, Packing, Slab, SlabBoxes, Slabs, WantedCells, WriteOptions, depth_for};
pub use tree_target::{ShardCheck, TreeTarget};
pub use tree_writer::TreeWriter;
pub use write::{build, build_slabs, build_source, build_tree, build_with, check_space};

//! Trees on disk: the two formats, what they have in common, and how trees are built.

pub mod autumnal;
pub mod builder;
pub mod container;
pub mod goblin;
mod write;

pub use builder::{BuildOptions, Slab, Slabs, depth_for};
pub use container::{
    Codec, Finding, Header, LevelCounts, Metadata, OpenOptions, ScopedTags, Shape, TagScope, TreeFormat,
    file_is_tree, split_commit,
};
#[cfg(feature = "mesh")]
pub(crate) use write::build_with;
pub(crate) use write::{build, check_room};
pub use write::{build_slabs, build_source, build_tree};

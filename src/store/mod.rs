//! Trees on disk: the two formats, how trees are built, and how files are written and read safely.

mod atomic;
pub mod autumnal;
pub mod build;
mod file;
mod format;
pub mod goblin;
mod storage;

pub use atomic::Output;
pub(crate) use atomic::folder;
pub use file::file_is_tree;
pub use file::{File, FileNode};
pub(crate) use file::{Typed, file_format, typed};
pub use format::{TreeFormat, split_commit};
pub use storage::{Mapped, Positioned, Storage};

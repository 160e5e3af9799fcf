//! Files with trees of lines: content 4 of a Goblin file.

mod reader;
mod summary;
mod verify;
mod writer;

pub(crate) use reader::LineNode;
pub use reader::{LineTree, is_line_file};
pub(crate) use summary::Summary;
pub(crate) use writer::LineWriter;

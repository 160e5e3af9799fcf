//! Point tree files: content type 3 of a Goblin file.

mod reader;
mod summary;
mod verify;
mod writer;

pub(crate) use reader::PointNode;
pub use reader::{PointTree, is_point_file};
pub(crate) use summary::Summary;
pub(crate) use writer::{Entry, PointWriter, node_entry};

//! Files of trees of points: content 3 of a Goblin file.

mod summary;
mod writer;

pub(crate) use summary::Summary;
pub(crate) use writer::PointWriter;

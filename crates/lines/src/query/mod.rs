//! Queries of trees of lines.

mod best;
mod block_index;
mod crossing;
mod nearest;
mod select;

pub use crossing::LineCrossing;
pub use nearest::{NearLine, NearestLines};
pub use select::LevelTotals;

//! Questions to trees on disk: cells, windows at any level, statistics, searches.

mod any;
pub mod cell_blocks;
pub(crate) mod dump;
mod find;
mod goblin;
mod stats;
mod walk;
mod window;

pub use any::{Tree, open};
pub(crate) use find::source_find;
pub use find::{Condition, FoundBlock};
pub use stats::{ChannelStatistics, Statistics};
pub(crate) use stats::{source_histogram, source_statistics};
pub(crate) use walk::node_bounds;

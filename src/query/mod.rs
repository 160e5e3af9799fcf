//! Questions to trees on disk: cells, windows at any level, statistics, searches.

mod any;
mod dump;
mod find;
mod goblin;
mod stats;
mod viewed;
mod walk;
mod window;

pub use any::{Tree, open};
pub use find::{Condition, FoundBlock};
pub use stats::{ChannelStatistics, Statistics};
pub(crate) use viewed::Viewed;

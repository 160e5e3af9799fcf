//! Questions to trees on disk: cells, windows at any level, statistics, searches.

mod any;

pub use any::{Tree, open};

//! Questions about trees of lines.

mod nearest;
mod select;

pub use nearest::NearLine;
pub use select::{Crossing, LevelTotals};

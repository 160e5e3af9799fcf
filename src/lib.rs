//! Spinney: quadtrees and octrees that are larger than memory.

mod error;
pub mod export;
pub mod import;
pub mod ops;
mod parallel;
mod progress;
pub mod query;
pub mod space;
pub mod store;
pub mod tree;
pub mod value;

pub use error::{Error, Result};
pub use progress::Progress;

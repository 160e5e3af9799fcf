//! Trees on disk: the Goblin format, and how files are written and read safely.

mod atomic;
pub mod goblin;
mod storage;

pub use atomic::Output;
pub(crate) use atomic::folder;
pub use storage::{Mapped, Positioned, Storage};

//! Trees on disk: the container, the Goblin format, and how files are written and read safely.

mod atomic;

pub use atomic::Output;

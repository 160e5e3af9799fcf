//! Trees as something to walk: sources, the tree in memory, and its expressions in text and bits.

pub mod df;
mod memory;
mod patch;
mod source;

pub use memory::MemTree;
pub use patch::{Change, Patch, Patched, PatchedNode};
pub use source::{CellBlock, Child, Overlay, Source, Stored, Verdict, Verdicts};

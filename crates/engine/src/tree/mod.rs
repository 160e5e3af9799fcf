//! Trees as something to walk: sources, the tree in memory, and its expressions in text and bits.

pub mod df;
mod memory;
mod source;

pub use memory::MemTree;
pub use source::{CellBlock, Child, Children, NodeState, Source, no_children};

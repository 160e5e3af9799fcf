//! Trees that can be traversed: sources, the tree in memory, and DF-expressions as text and as
//! bits.

pub mod df;
mod memory;
mod source;

pub use memory::MemTree;
pub use source::{CellBlock, Child, Children, NodeState, Source, no_children};

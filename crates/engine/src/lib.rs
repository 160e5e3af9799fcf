//! Trees of cells: sources, the two formats, building, questions, operations.

pub mod dataset;
pub mod ops;
pub mod query;
pub mod store;
pub mod tree;

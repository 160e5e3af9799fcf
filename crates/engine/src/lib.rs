//! Trees of cells: sources, the two file formats, building, queries and operations.

pub mod dataset;
pub mod ops;
pub mod query;
pub mod store;
pub mod tree;

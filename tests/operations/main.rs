//! Operations on trees, and questions to them, against arrays of cells.

#[path = "../common/mod.rs"]
mod common;

mod crops;
mod operations;
mod queries;
mod set_operations;
mod solids;
mod symmetries;

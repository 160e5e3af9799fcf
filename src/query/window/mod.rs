//! Windows: the values of any box of cells at any level.

mod autumnal;
mod goblin;
mod source;

pub(crate) use source::{Canvas, fill_value, wires_of};

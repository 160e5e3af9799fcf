//! Arithmetic with the cells of trees: an expression over layers, channels and files of one grid is a tree.

mod calculation;
mod composite;
mod expression;
mod kernel;
mod operands;
mod parse;
mod source;
#[cfg(test)]
mod tests;

pub use calculation::Calculation;
pub use source::Calculated;

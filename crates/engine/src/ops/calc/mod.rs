//! Arithmetic with the cells of trees: an expression over layers, channels and files on one grid
//! becomes a tree.
//!
//! 1. `calculation.rs` parses the operation. `parse.rs` compiles its expression to postfix form, by
//!    operator precedence, with bounded depth and length (`expression.rs`).
//! 2. `operands.rs` resolves names (files that the operation lists, layers, bands) and aligns all
//!    trees with the first one's cells (`reconcile/`), as views.
//! 3. `source.rs` is the tree of the results, and a source for views (`view_source.rs`). A node is
//!    settled without its cells if the operands' nodes determine its value (`settle` in
//!    `kernel.rs`). Otherwise boxes of all trees are read as rows (`affine/level.rs`: from a level
//!    of the file where cells coincide, repeating coarser ones), and computed strip by strip in
//!    f64. NaN is VOID. Only the kernel knows sample types.
//! 4. A composite (`composite.rs`) has an expression per channel, which copies a layer's channel
//!    unchanged.
//!
//! Every level is computed in the same way. The level of the cells is exact, and files are built
//! from its blocks; windows of coarser levels are approximate. Traversals by node get nodes from
//! blocks that are computed once (`blocks.rs`), whose states follow from the cells.

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

//! Connected components of cells of equal value: their labels, a table of the labels, and sieving,
//! which merges small components into their neighbours.
//!
//! These operations scan all cells before the first result is available. They are therefore
//! available in [`transform`](super::transform), but not in views.
//!
//! 1. `sweep.rs` traverses a view in FD order: blocks of cells, and larger uniform nodes.
//!    `local.rs` finds the components of a block by runs in its rows. `border.rs` keeps the runs at
//!    the faces of nodes until their siblings are complete, and reports which runs touch.
//! 2. `labels.rs` keeps a union-find forest of the components at borders of blocks, in memory or in
//!    a temporary file (`words.rs`), and numbers all components by their first cells. `sieve.rs`
//!    keeps a forest of all components of blocks in memory, with the neighbours of small ones, and
//!    merges the small ones into them. Both store the visited nodes (`units.rs`) and, within a
//!    memory limit, the component of each cell in a block (`pattern.rs`).
//! 3. `source.rs` is the tree of the result, and a source for views: the components of each block
//!    get their labels or values. Blocks whose pattern was not kept are read again.
//! 4. `table.rs` makes a table of labels: size, box and neighbours of each.

mod border;
mod connectivity;
mod labels;
mod local;
mod pattern;
mod rows;
mod sieve;
mod source;
mod sweep;
mod table;
#[cfg(test)]
mod tests;
mod units;
mod words;

pub use connectivity::{Connectivity, Sieve};
pub use source::Regions;
pub(super) use source::ScanContext;
pub(crate) use table::find_labels;
pub use table::{Label, LabelNeighbour, LabelRequest, LabelSummary, LabelVisitor};

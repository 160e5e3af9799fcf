//! Components of cells of equal value: their labels, a table of these, and the small ones given to their neighbours.
//!
//! What a step has to know of all cells before it can hand out the first: so these are for [`transform`](super::transform), not for views.

mod border;
mod labels;
mod local;
mod pattern;
mod rows;
mod sieve;
mod source;
mod step;
mod sweep;
mod table;
#[cfg(test)]
mod tests;
mod units;
mod words;

pub(super) use source::Passes;
pub use source::Regions;
pub use step::{Connectivity, Sieve};
pub(crate) use table::find_labels;
pub use table::{Label, LabelNeighbour, LabelRequest, LabelSummary, LabelVisitor};

//! Components of cells of equal value: their labels, and the small ones given to their neighbours.
//!
//! What a step has to know of all cells before it can hand out the first: so these are for [`transform`](super::transform), not for views.

mod border;
mod labels;
mod local;
mod sieve;
mod source;
mod step;
mod sweep;
#[cfg(test)]
mod tests;
mod words;

pub(super) use source::Passes;
pub use source::Regions;
pub use step::{Connectivity, Sieve};

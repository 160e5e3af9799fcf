//! Constructive solid geometry: solids of transformed and combined primitives, defined by a text
//! format.
//!
//! They are converted to octrees of cells, classifying whole blocks where possible, and to exact
//! models with facets.

mod affine;
mod bounded_solid;
mod box_state;
mod cells;
mod exact;
mod expression;
mod facets;
mod field;
mod lowered;
mod model;
mod outline;
mod patches;
mod shape;
mod source;
mod syntax;
#[cfg(test)]
mod tests;

pub use cells::CsgImport;
pub use exact::{CsgExactOptions, CsgExactReport, ShellReport, import_exact_csg};
pub use model::Csg;

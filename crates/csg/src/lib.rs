//! Solids of primitives that are moved and combined (constructive solid geometry), as a text tells them: octrees of cells, by what is sure
//! of blocks, and exact models, by facets.

mod affine;
mod cells;
mod exact;
mod expression;
mod facets;
mod field;
mod lowered;
mod model;
mod outline;
mod place;
mod placed;
mod shape;
mod source;
mod syntax;
#[cfg(test)]
mod tests;

pub use cells::CsgImport;
pub use exact::{CsgExactOptions, CsgExactReport, import_exact_csg};
pub use model::Csg;

//! The contents of the papers in `docs/literature.md`, item by item, checked by worked examples and
//! by models that follow the paper.

#[path = "../common/mod.rs"]
mod common;

mod bintrees;
mod bsp;
mod chain_codes;
#[cfg(feature = "csg")]
mod csg;
#[cfg(feature = "cli")]
mod drawing;
mod euler;
#[cfg(feature = "cli")]
mod indices;
mod lines;
mod operations;
mod points;
mod predictive;
mod quadtrees;
#[cfg(feature = "reconstruction")]
mod reconstruction;
#[cfg(feature = "cli")]
mod solid_text;
#[path = "../../examples/literature/mod.rs"]
mod structures;
#[cfg(feature = "vector")]
mod surfaces;
#[cfg(feature = "cli")]
mod table;

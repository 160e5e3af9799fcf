//! The contents of the papers of `docs/literature.md`, item by item, held to worked examples and to models that follow the text.

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
#[path = "../../examples/literature/mod.rs"]
mod structures;
#[cfg(feature = "vector")]
mod surfaces;
#[cfg(feature = "cli")]
mod table;

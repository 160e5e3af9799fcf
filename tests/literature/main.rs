//! The contents of the papers of `docs/literature.md`, item by item, held to worked examples and to models that follow the text. (Those of the two formats: `formats/literature.rs`.)

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
mod points;
mod predictive;
#[cfg(feature = "vector")]
mod surfaces;

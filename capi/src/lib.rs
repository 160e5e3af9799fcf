//! Spinney files from C: the functions of `include/spinney.h`, which is made of this crate by cbindgen.
//!
//! Handles are opaque, buffers belong to the caller, failures are codes with a text. Nothing prints, exits or unwinds into
//! the caller. A dataset may be read by any number of threads at once.
#![allow(non_camel_case_types)] // names as C has them
#![allow(clippy::missing_safety_doc)] // whoever calls is a C program: the rules are in `spinney.h`'s introduction

mod blocks;
mod dataset;
mod exact;
mod layers;
#[cfg(test)]
mod mesh_tests;
mod meshes;
mod metadata;
mod model;
#[cfg(test)]
mod model_tests;
mod parts;
mod questions;
mod sections;
mod shells;
mod status;
#[cfg(test)]
mod tests;
mod warnings;

pub use blocks::*;
pub use dataset::*;
pub use exact::*;
pub use layers::*;
pub use meshes::*;
pub use model::*;
pub use parts::*;
pub use questions::*;
pub use sections::*;
pub use shells::*;
pub use status::*;
pub use warnings::*;

//! The C interface of Spinney: the functions of `include/spinney.h`, which cbindgen generates from
//! this crate.
//!
//! Handles are opaque, buffers belong to the caller, and failures are status codes with a message.
//! No function prints, exits or unwinds into the caller. Any number of threads may read a dataset
//! at once.
#![allow(non_camel_case_types)] // C names
// (Callers are C programs: the introduction of `spinney.h` has the safety rules.)
#![allow(clippy::missing_safety_doc)]

mod blocks;
mod dataset;
mod exact;
mod layers;
#[cfg(test)]
mod level_tests;
mod levels;
#[cfg(test)]
mod mesh_tests;
mod meshes;
mod metadata;
mod model;
#[cfg(test)]
mod model_tests;
mod parts;
mod queries;
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
pub use levels::*;
pub use meshes::*;
pub use model::*;
pub use parts::*;
pub use queries::*;
pub use sections::*;
pub use shells::*;
pub use status::*;
pub use warnings::*;

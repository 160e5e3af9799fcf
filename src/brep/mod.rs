//! Exact models: boundary representations on an integer grid, kept as they are and not as cells.

mod face;
mod grid;
pub mod questions;

pub use face::{Face, FaceList, Faces};
pub use grid::{Grid, MOST_BITS};

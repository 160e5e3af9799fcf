//! Questions to exact models: answers are of the surface itself, and not of cells.
//!
//! Where something is decided (whether a line meets a face, on which side of it a point lies), it is decided in whole
//! numbers; lengths and volumes are rounded, and each says how much.

mod coverage;
mod line;
mod mass;
mod nearest;
mod plane;
mod ratio;
#[cfg(test)]
mod testing;

pub use coverage::{Coverage, CoverageSums, Cube};
pub use line::{Crossing, Line};
pub use mass::{MassProperties, MassSums};
pub use nearest::{Nearest, nearest_on_face};

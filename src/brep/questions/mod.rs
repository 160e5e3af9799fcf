//! Questions to exact models: answers are of the surface itself, and not of cells.
//!
//! Where something is decided (whether a line meets a face, on which side of it a point lies), it is decided in whole
//! numbers; lengths and volumes are rounded, and each says how much.

mod cells;
mod contains;
mod coverage;
mod distance;
mod line;
mod mass;
mod nearest;
mod plane;
mod ratio;
mod ray;
mod region;
#[cfg(test)]
mod testing;
mod visited;

pub use cells::CellCoverage;
pub use contains::Location;
pub use coverage::{Coverage, CoverageSums, Cube};
pub use distance::SurfacePoint;
pub use line::{Crossing, Line};
pub use mass::{MassProperties, MassSums};
pub use nearest::{Nearest, nearest_on_face};
pub use ray::Hit;
pub use region::BoxPlace;
pub use visited::Visited;

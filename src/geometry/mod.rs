//! Polygons with holes on an integer grid: against octants, and into triangles. Exact, in integers.

mod box3;
pub(crate) mod clipped;
mod ears;
mod intersection;
mod plane;
mod polygon;
pub(crate) mod triangle;
mod triangulate;

pub use box3::Box3;
pub use intersection::{Intersection, Stage, Stages};
pub use polygon::{Flaw, Polygon};
pub use triangulate::Triangulator;

//! Polygons with holes on an integer grid: against octants, and into triangles. Exact, in integers.

mod box3;
pub(crate) mod clipped;
pub(crate) mod crossing;
mod ears;
mod intersection;
mod plane;
mod polygon;
pub(crate) mod rank;
pub(crate) mod triangle;
mod triangulate;

pub use box3::Box3;
pub use intersection::{Intersection, Stage, Stages};
pub use polygon::{Flaw, Polygon};
pub use triangulate::Triangulator;

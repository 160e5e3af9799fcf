//! Polygons with holes on an integer grid: octant intersection, triangulation, and conversion to
//! single rings. Exact, in integers.

mod box3;
mod bridges;
pub mod clipped;
mod ears;
mod intersection;
mod plane;
mod polygon;
mod status;
mod sweep;
pub mod triangle;
mod triangulate;
mod turn;

pub use box3::Box3;
pub use bridges::{join_rings, split_bridges};
pub use intersection::{Intersection, Stage, Stages};
pub(crate) use plane::is_convex;
pub use polygon::{Flaw, GridPolygon};
pub use triangulate::Triangulator;

//! Polygons with holes on an integer grid: against octants, into triangles, and as
//! single rings. Exact, in integers.

mod box3;
mod bridges;
pub(crate) mod clipped;
pub(crate) mod crossing;
mod ears;
mod intersection;
mod plane;
mod polygon;
pub(crate) mod rank;
mod status;
mod sweep;
pub(crate) mod triangle;
mod triangulate;

pub use box3::Box3;
pub use bridges::{join_rings, split_bridges};
pub use intersection::{Intersection, Stage, Stages};
pub use polygon::{Flaw, Polygon};
pub use triangulate::Triangulator;

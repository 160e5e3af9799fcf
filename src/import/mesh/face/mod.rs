//! Faces against octants, and faces into triangles: exact, in integers.

mod box3;
mod ears;
mod intersection;
mod plane;
mod polygon;
pub(super) mod triangle;
mod triangulate;

pub use box3::Box3;
pub use intersection::{Intersection, Stage, Stages};
pub use polygon::{Flaw, Polygon};
pub use triangulate::Triangulator;

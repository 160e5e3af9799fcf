//! Faces against octants, and faces into triangles: exact, in integers.

mod box3;
mod ears;
mod plane;
mod polygon;
pub(super) mod triangle;
mod triangulate;
mod verdict;

pub use box3::Box3;
pub use polygon::{Flaw, Polygon};
pub use triangulate::Triangulator;
pub use verdict::{Stage, Stages, Verdict};

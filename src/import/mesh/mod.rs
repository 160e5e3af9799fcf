//! Importers of solids: boundary representations, read face by face.

mod box3;
mod ears;
mod model;
mod plane;
mod polygon;
mod triangle;
mod triangulate;

pub use box3::Box3;
pub use model::{Face, Model, ModelInfo};
pub use polygon::{Flaw, Polygon, Stage, Stages, Verdict};
pub use triangulate::Triangulator;

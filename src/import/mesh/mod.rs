//! Importers of solids: boundary representations, read face by face, become octrees.

mod bits;
mod box3;
mod build;
mod closure;
mod crossing;
mod ears;
mod field;
mod fill;
mod grid;
mod model;
mod plan;
mod plane;
mod polygon;
mod solid;
mod triangle;
mod triangles;
mod triangulate;

pub use box3::Box3;
pub use build::{Decided, SolidReport};
pub use model::{Face, Model, ModelInfo};
pub use plan::{DEFAULT_MEMORY, Resolution, SolidImport, SolidOptions, Up, open_all, plan_models};
pub use polygon::{Flaw, Polygon, Stage, Stages, Verdict};
pub use solid::{Attribute, Boundary};
pub use triangulate::Triangulator;

/// Whether a path looks like a model's.
pub fn is_model(path: &std::path::Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or("");
    let names = ["ply", "obj", "stl", "off", "json", "jsonl", "cityjson"];
    names.iter().any(|name| extension.eq_ignore_ascii_case(name))
}

//! Importers of solids: boundary representations, read face by face, become octrees.

mod bits;
mod build;
mod closure;
mod crossing;
mod field;
mod fill;
mod grid;
mod model;
mod plan;
mod solid;
mod triangle;
mod triangles;
mod triangulate;

pub use model::{Face, Model, ModelInfo};
pub use build::{Decided, SolidReport};
pub use plan::{DEFAULT_MEMORY, Resolution, SolidImport, SolidOptions, Up, open_all, plan_models};
pub use solid::{Attribute, Boundary};

/// Opens a model.
pub fn open(path: &std::path::Path, _memory: u64) -> crate::Result<Box<dyn Model>> {
    Err(crate::Error::unsupported(path, "x", "y"))
}

/// Whether a path looks like a model's.
pub fn is_model(path: &std::path::Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or("");
    let names = ["ply", "obj", "stl", "off", "json", "jsonl", "cityjson"];
    names.iter().any(|name| extension.eq_ignore_ascii_case(name))
}

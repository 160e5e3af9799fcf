//! Importers of solids: boundary representations, read face by face, become octrees.

mod bits;
mod box3;
mod build;
mod closure;
mod corners;
mod crossing;
mod ears;
mod field;
mod fill;
mod grid;
mod model;
mod plan;
mod plane;
mod ply;
mod polygon;
mod solid;
mod source;
mod text;
mod triangle;
mod triangles;
mod triangulate;
mod vertices;

use std::path::Path;

pub use self::box3::Box3;
pub use self::build::{Decided, SolidReport};
pub use self::model::{Face, Model, ModelInfo};
pub use self::plan::{DEFAULT_MEMORY, Resolution, SolidImport, SolidOptions, Up, open_all, plan_models};
pub use self::polygon::{Flaw, Polygon, Stage, Stages, Verdict};
pub use self::solid::{Attribute, Boundary};
use self::source::Source;
pub use self::triangulate::Triangulator;
use crate::{Error, Result};

/// Opens a boundary representation, whose format is told from its first bytes, and from its name only where those
/// leave it open.
///
/// About `memory` bytes are used at most. What does not fit, such as the vertices of a large text file, goes to an
/// unnamed temporary file in the system's folder for those (`TMPDIR`). The file itself is mapped: it must not be
/// truncated while the model is in use.
///
/// # Errors
/// If the file cannot be read, is of no format that is read here, is damaged, or uses something unsupported.
pub fn open(path: &Path, memory: u64) -> Result<Box<dyn Model>> {
    let source = Source::open(path)?;
    let start = &source.bytes()[..source.bytes().len().min(1024)];
    match start {
        [b'p', b'l', b'y', b'\r' | b'\n' | b' ', ..] => ply::open(source, memory),
        _ => Err(Error::unsupported(path, "a file of this format", "convert it to PLY")),
    }
}

/// Whether a path looks like a model's.
pub fn is_model(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or("");
    let names = ["ply", "obj", "stl", "off", "json", "jsonl", "cityjson"];
    names.iter().any(|name| extension.eq_ignore_ascii_case(name))
}

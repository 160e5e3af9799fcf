//! Importers of solids: boundary representations, read face by face.

mod corners;
mod model;
mod ply;
mod source;
mod text;
mod vertices;

use std::path::Path;

pub use self::model::{Face, Model, ModelInfo};
use self::source::Source;
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

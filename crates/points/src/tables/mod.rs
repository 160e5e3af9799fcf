//! Points from binary tables: the vertices of PLY files, and `NumPy` arrays.

mod columns;
mod npy;
mod ply;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::source::WorldPoints;
use spinney_base::{Error, Result};
use spinney_records::npy::MAGIC;

/// Number of points after which the pages of a mapped file are released.
const RELEASE_EVERY: u64 = 1 << 17;

/// Points of a table, and remarks on skipped contents of the file.
pub(crate) struct Table {
    pub(crate) points: Box<dyn WorldPoints>,
    pub(crate) remarks: Vec<String>,
}

/// Detects the format by the first bytes, or by the name if the file cannot be read: NPY (`true`),
/// PLY (`false`) or `None`.
fn is_npy(path: &Path) -> Option<bool> {
    let named = |ending: &str| path.extension().is_some_and(|own| own.eq_ignore_ascii_case(ending));
    let mut start = [0; 6];
    // Only regular files are read: bytes read from a pipe would be lost.
    if path.is_file() && File::open(path).is_ok_and(|mut file| file.read_exact(&mut start).is_ok()) {
        let is_ply = start.starts_with(b"ply\n") || start.starts_with(b"ply\r");
        return if start == MAGIC { Some(true) } else { is_ply.then_some(false) };
    }
    if named("npy") { Some(true) } else { named("ply").then_some(false) }
}

/// Returns whether a file is a PLY or NPY file, whose points can become a tree.
pub(crate) fn is_point_table(path: &Path) -> bool {
    is_npy(path).is_some()
}

/// Opens a table of points.
///
/// # Errors
/// If it cannot be read, is corrupt, or has no columns x and y.
pub(crate) fn open(path: &Path) -> Result<Table> {
    match is_npy(path) {
        Some(true) => npy::open(path),
        Some(false) => ply::open(path),
        None => Err(Error::unsupported(path, "this file format for points", "use a PLY or NPY file")),
    }
}

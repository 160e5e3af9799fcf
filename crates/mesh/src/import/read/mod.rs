//! Mesh readers: one file or directory per format, one for in-memory arrays, and shared code.

mod arrays;
mod city_geometry;
pub(crate) mod city_semantics;
mod city_templates;
mod cityjson;
mod colour_range;
mod corners;
mod euler;
mod exact;
mod face_values;
mod gltf;
mod model_file;
mod obj;
mod off;
mod parts;
mod ply;
mod spill;
mod stl;
#[cfg(test)]
mod tests;
mod vertices;

use std::path::{Path, PathBuf};

use self::model_file::ModelFile;
use super::{MeshFace, Model, ModelInfo};
use spinney_base::Result;
use spinney_base::io::{FileAccess, without_query};
use spinney_container::OtherFormat;
use spinney_manifest::is_manifest_file;

pub use self::arrays::{MeshArrays, MeshColours};
pub(crate) use self::face_values::MATERIAL;
pub(crate) use self::obj::MAX_LIBRARY_BYTES;

/// Opens a boundary representation. The format is recognized by the file's first bytes. The file
/// name is used only if those are ambiguous.
///
/// Uses about `memory` bytes at most. Larger data, such as the vertices of a large text file, goes
/// to an unnamed temporary file in the system's temporary directory (`TMPDIR`). The file itself is
/// memory-mapped: it must not be truncated while the model is in use.
///
/// # Errors
/// If the file cannot be read, has an unknown format, is corrupt, or uses unsupported features.
pub fn open(path: &Path, memory: u64) -> Result<Box<dyn Model>> {
    open_with(path, memory, &FileAccess::default())
}

/// Opens a boundary representation as [`open`] does, with `access`. Exact models may be remote. If
/// files are read at positions instead of mapped, a mesh is first copied to an unnamed temporary
/// file.
///
/// # Errors
/// Those of [`open`].
pub fn open_with(path: &Path, memory: u64, access: &FileAccess) -> Result<Box<dyn Model>> {
    if let Some(model) = exact::open(path, memory, access)? {
        return Ok(model);
    }
    let mut source = ModelFile::open(path, access)?;
    // The first 80 bytes of binary STL are arbitrary and may start with a byte order mark.
    if !stl::is_binary(source.bytes()) {
        source.skip_byte_order_mark();
    }
    match format(&source) {
        Some(Format::Ply) => ply::open(source, memory),
        Some(Format::Stl) => stl::open(source, memory),
        Some(Format::Off) => off::open(source, memory),
        Some(Format::Euler) => euler::open(source, memory),
        Some(Format::CityJson) => cityjson::open(source, memory),
        Some(Format::Obj) => obj::open(source, memory),
        Some(Format::Gltf) => gltf::open(source, memory, access),
        None => Err(OtherFormat::refuse_source(
            path,
            source.bytes(),
            "a PLY, OBJ, STL, OFF, glTF, CityJSON or .euler file",
        )),
    }
}

/// Supported formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Ply,
    Stl,
    Off,
    Euler,
    CityJson,
    Obj,
    Gltf,
}

fn format(source: &ModelFile) -> Option<Format> {
    let bytes = source.bytes();
    let extension = source.path().extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    if extension == "euler" {
        return Some(Format::Euler);
    }
    if matches!(bytes, [b'p', b'l', b'y', b'\r' | b'\n' | b' ', ..]) {
        return Some(Format::Ply);
    }
    if off::has_keyword(bytes) {
        return Some(Format::Off);
    }
    if gltf::is_binary(bytes) || gltf::is_text(bytes, &extension) {
        return Some(Format::Gltf);
    }
    if bytes.trim_ascii_start().starts_with(b"{") && extension != "stl" {
        return Some(Format::CityJson);
    }
    if stl::is_binary(bytes) || stl::is_text(bytes) {
        return Some(Format::Stl);
    }
    if OtherFormat::is_marked(bytes) {
        return None;
    }
    match extension.as_str() {
        "ply" => Some(Format::Ply),
        "stl" => Some(Format::Stl),
        "off" => Some(Format::Off),
        "obj" => Some(Format::Obj),
        _ => obj::is_likely(bytes).then_some(Format::Obj),
    }
}

/// Paths of all files that reading a model accesses, whether they exist or not: the file itself and
/// its material libraries or buffers.
///
/// # Errors
/// If the file cannot be read.
pub fn files_of(path: &Path, access: &FileAccess) -> Result<Vec<PathBuf>> {
    let mut files = vec![path.to_path_buf()];
    if !spinney_brep::is_model_file(path, access)? {
        let source = ModelFile::open(path, access)?;
        match format(&source) {
            Some(Format::Obj) => files.extend(obj::libraries(&source)),
            Some(Format::Gltf) => files.extend(gltf::siblings(&source)),
            _ => {}
        }
    }
    Ok(files)
}

/// Opens several models. `memory` is the total for building a solid from them, in bytes.
///
/// # Errors
/// If one of the files cannot be read.
pub fn open_all(paths: &[PathBuf], memory: u64) -> Result<Vec<Box<dyn Model>>> {
    open_all_with(paths, memory, &FileAccess::default())
}

/// Opens several models like [`open_all`], each with `access` like [`open_with`].
///
/// # Errors
/// Those of [`open_all`].
pub fn open_all_with(paths: &[PathBuf], memory: u64, access: &FileAccess) -> Result<Vec<Box<dyn Model>>> {
    let share = memory / 4 / paths.len().max(1) as u64;
    paths.iter().map(|path| open_with(path, share, access)).collect()
}

/// Whether a path has a model's file extension, or is an exact model.
///
/// # Errors
/// If the file system or the remote host fails.
pub fn is_model(path: &Path, access: &FileAccess) -> Result<bool> {
    let extension = without_query(path).extension().and_then(|extension| extension.to_str()).unwrap_or("");
    let names = ["ply", "obj", "stl", "off", "json", "jsonl", "cityjson", "gltf", "glb", "euler"];
    // (A manifest of trees is JSON, too.)
    let is_named = names.iter().any(|name| extension.eq_ignore_ascii_case(name));
    Ok(is_named && !is_manifest_file(path, access)? || spinney_brep::is_model_file(path, access)?)
}

//! Sidecar files of feature files.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use spinney_base::{Error, Result};
use spinney_crs::Crs;

/// Maximum file size in bytes; real files have a few thousand.
const MOST: u64 = 1 << 20;

/// Returns the path of a sidecar file, with its extension in lower case, or in upper case if only
/// that exists.
pub(super) fn path_of(path: &Path, ending: &str) -> PathBuf {
    let own = path.with_extension(ending);
    let upper = path.with_extension(ending.to_ascii_uppercase());
    if !own.exists() && upper.exists() { upper } else { own }
}

/// Opens a sidecar file; `None` if it does not exist.
pub(super) fn open(path: &Path, ending: &str) -> Result<Option<(File, PathBuf)>> {
    let path = path_of(path, ending);
    match File::open(&path) {
        Ok(file) => Ok(Some((file, path))),
        Err(cause) if cause.kind() == ErrorKind::NotFound => Ok(None),
        Err(cause) => Err(Error::io(path, "open")(cause)),
    }
}

/// Reads a small sidecar file; `None` if it does not exist.
pub(super) fn text(path: &Path, ending: &str) -> Result<Option<String>> {
    let Some((file, path)) = open(path, ending)? else { return Ok(None) };
    let mut bytes = Vec::new();
    file.take(MOST + 1).read_to_end(&mut bytes).map_err(Error::io(&path, "read"))?;
    if bytes.len() as u64 > MOST {
        return Err(Error::corrupt(path, "file", format!("more than {MOST} bytes"), "at most that many"));
    }
    Ok(Some(String::from_utf8_lossy(&bytes).into_owned()))
}

/// Reads the coordinate system from the `.prj` file; `None` if it does not exist or is empty.
pub(super) fn definition(path: &Path) -> Result<Option<Crs>> {
    let Some(text) = text(path, "prj")?.filter(|text| !text.trim().is_empty()) else { return Ok(None) };
    let wrong = |error: Error| {
        Error::corrupt(path_of(path, "prj"), "file", error.to_string(), "the WKT of a coordinate system")
    };
    Crs::parse(&text).map(Some).map_err(wrong)
}

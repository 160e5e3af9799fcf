//! Small files beside a file of features.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use spinney_base::{Error, Result};
use spinney_crs::Crs;

/// Bytes of such a file; real ones have a few thousand.
const MOST: u64 = 1 << 20;

/// The path of a file beside another one, in the case that the ending has there.
pub(super) fn path_of(path: &Path, ending: &str) -> PathBuf {
    let own = path.with_extension(ending);
    let upper = path.with_extension(ending.to_ascii_uppercase());
    if !own.exists() && upper.exists() { upper } else { own }
}

/// Opens a file beside another one; `None` if there is none.
pub(super) fn open(path: &Path, ending: &str) -> Result<Option<(File, PathBuf)>> {
    let path = path_of(path, ending);
    match File::open(&path) {
        Ok(file) => Ok(Some((file, path))),
        Err(cause) if cause.kind() == ErrorKind::NotFound => Ok(None),
        Err(cause) => Err(Error::io(path, "open")(cause)),
    }
}

/// The text of a small file; `None` if there is none.
pub(super) fn text(path: &Path, ending: &str) -> Result<Option<String>> {
    let Some((file, path)) = open(path, ending)? else { return Ok(None) };
    let mut bytes = Vec::new();
    file.take(MOST + 1).read_to_end(&mut bytes).map_err(Error::io(&path, "read"))?;
    if bytes.len() as u64 > MOST {
        return Err(Error::corrupt(path, "file", format!("more than {MOST} bytes"), "a few"));
    }
    Ok(Some(String::from_utf8_lossy(&bytes).into_owned()))
}

/// The coordinate system in the file `.prj` beside another one; `None` if there is none.
pub(super) fn definition(path: &Path) -> Result<Option<Crs>> {
    let Some(text) = text(path, "prj")?.filter(|text| !text.trim().is_empty()) else { return Ok(None) };
    let wrong = |error: Error| {
        Error::corrupt(path_of(path, "prj"), "file", error.to_string(), "the WKT of a coordinate system")
    };
    Crs::parse(&text).map(Some).map_err(wrong)
}

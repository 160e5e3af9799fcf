//! Formats of features: which one a file has, by its first bytes and its name.

use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;

use super::feature::{FeatureOptions, FeatureReader, Wanted};
use super::geojson;
use spinney_base::{Error, Result};
use spinney_container::{FIRST_BYTES, OtherFormat};

/// Opens a file with the reader of its format.
pub(super) fn open(
    path: &Path,
    options: &FeatureOptions,
    wanted: &mut Wanted,
) -> Result<Box<dyn FeatureReader>> {
    let mut file = regular(path)?;
    let mut first = Vec::new();
    (&mut file).take(FIRST_BYTES as u64).read_to_end(&mut first).map_err(Error::io(path, "read"))?;
    file.rewind().map_err(Error::io(path, "read"))?;
    let begin = first.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&first).iter();
    match begin.copied().find(|byte| !byte.is_ascii_whitespace() && *byte != 0x1e) {
        Some(b'{') => Ok(Box::new(geojson::GeoJson::open(Box::new(file), path, options, wanted)?)),
        _ => {
            let other = || Error::corrupt(path, "first bytes", "another format", "GeoJSON");
            Err(OtherFormat::refuse_unread(path, &first).unwrap_or_else(other))
        }
    }
}

/// A file that can be read more than once: what a stream has goes to a temporary one.
fn regular(path: &Path) -> Result<File> {
    let mut file = File::open(path).map_err(Error::io(path, "open"))?;
    if file.metadata().is_ok_and(|metadata| metadata.is_file() || metadata.is_dir()) {
        return Ok(file);
    }
    let mut copy =
        tempfile::tempfile().map_err(Error::io(std::env::temp_dir(), "create a temporary file"))?;
    std::io::copy(&mut file, &mut copy).map_err(Error::io(path, "read"))?;
    copy.rewind().map_err(Error::io(path, "read"))?;
    Ok(copy)
}

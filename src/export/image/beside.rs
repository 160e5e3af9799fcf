//! What a picture's file cannot hold, in a file beside it.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use super::Format;
use super::tiff_tags::{escaped, geo_keys};
use crate::io::Output;
use crate::space::Frame;
use crate::{Error, Progress, Result};

/// Writes the coordinate system of a GeoTIFF file that its keys cannot define into `.aux.xml`, as GDAL does, and
/// tells so; also if such a file is there that is of an earlier picture.
///
/// # Errors
/// If it cannot be written.
pub(in crate::export) fn write(
    picture: &Path,
    format: Format,
    frame: Option<&Frame>,
    progress: &dyn Progress,
) -> Result<()> {
    if format != Format::Tiff {
        return Ok(());
    }
    let mut name = picture.as_os_str().to_owned();
    name.push(".aux.xml");
    let path = PathBuf::from(name);
    let crs = frame.and_then(|frame| frame.crs.as_ref()).filter(|crs| geo_keys(crs).is_none());
    let is_stdout = picture == Path::new("-");
    let Some(crs) = crs else {
        if !is_stdout && path.exists() {
            progress.warn(
                &path,
                "is of an earlier picture of that name: programs may take its coordinate system",
            );
        }
        return Ok(());
    };
    if is_stdout {
        let text = "has no coordinate system: GeoTIFF has no keys for its definition, and files beside standard output \
                    there are none";
        progress.warn(picture, text);
        return Ok(());
    }
    let definition = escaped(&crs.definition());
    let text = format!("<PAMDataset>\n  <SRS>{definition}</SRS>\n</PAMDataset>\n");
    let mut output = Output::create(&path)?;
    output.write_all(text.as_bytes()).map_err(Error::io(&path, "write"))?;
    output.commit()?;
    progress.warn(&path, "has the coordinate system of the picture, for which GeoTIFF has no keys");
    Ok(())
}

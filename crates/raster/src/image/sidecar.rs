//! The sidecar of an image: GDAL's `.aux.xml` file next to it, for metadata that the image cannot
//! hold.

use std::io::Write as _;
use std::path::Path;

use super::tiff_tags::geo_keys;
use super::{Format, gdal_xml};
use spinney_base::io::{FileAccess, sidecar_of};
use spinney_base::{Error, Progress, Result};
use spinney_container::Metadata;

/// Writes metadata that a GeoTIFF file cannot hold into a sidecar, as GDAL does: the names of
/// values, and a coordinate system that no keys define, with a warning. Without such metadata,
/// removes the sidecar of an earlier image of that name, also with a warning: programs would apply
/// it to the new image.
///
/// # Errors
/// If it cannot be written.
pub(crate) fn write(
    (image, access): (&Path, &FileAccess),
    format: Format,
    metadata: &Metadata,
    progress: &dyn Progress,
) -> Result<()> {
    if format != Format::Tiff {
        return Ok(());
    }
    let crs = match &metadata.control_points {
        Some(points) => points.crs.as_ref(),
        None => metadata.frame.crs.as_ref(),
    };
    let crs = crs.filter(|crs| geo_keys(crs).is_none());
    if image == Path::new("-") {
        if crs.is_some() {
            let text = "has no coordinate system: GeoTIFF has no keys for it, and standard output has no \
                        sidecar file";
            progress.warn(image, text);
        }
        return Ok(());
    }
    let path = sidecar_of(image);
    let Some(xml) = gdal_xml::sidecar(metadata, crs) else {
        if path.exists() {
            std::fs::remove_file(&path).map_err(Error::io(&path, "remove"))?;
            progress.warn(&path, "belonged to an earlier image of this name, and was removed");
        }
        return Ok(());
    };
    let mut output = access.create(&path)?;
    output.write_all(xml.as_bytes()).map_err(Error::io(&path, "write"))?;
    output.commit()?;
    if crs.is_some() {
        progress.warn(&path, "stores the coordinate system of the image, for which GeoTIFF has no keys");
    }
    Ok(())
}

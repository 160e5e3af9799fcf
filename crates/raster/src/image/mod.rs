//! Writers of images and arrays, row by row.

mod exr;
mod gdal_xml;
mod npy;
mod png;
mod raw;
pub(super) mod seekable;
mod sidecar;
pub(super) mod tiff;
pub(super) mod tiff_coding;
pub(super) mod tiff_tags;
mod webp;

use std::path::Path;

pub(super) use npy::array_header;
pub(super) use sidecar::write as write_sidecar;

use spinney_base::io::Output;
use spinney_base::value::ValueType;
use spinney_base::{Error, Result};
use spinney_container::Metadata;

/// Size, samples and metadata of an image to be written.
#[derive(Clone, Debug)]
pub struct ImageSpec {
    /// Columns.
    pub width: u64,
    /// Rows.
    pub height: u64,
    /// Type and number of a pixel's samples.
    pub value: ValueType,
    /// Whether the last sample is opacity.
    pub alpha: bool,
    /// Whether pixels may be VOID. PNG then gets an opacity channel if it has none. PNG with a
    /// palette uses `nodata` if that is a palette index, and otherwise writes colours.
    pub void: bool,
    /// Metadata, for formats that can hold it. Frame and control points refer to the pixels.
    /// `nodata` is the number that VOID pixels have in every channel of the rows that are written.
    pub metadata: Metadata,
}

impl ImageSpec {
    /// Whether a TIFF file needs a mask for VOID pixels, because neither opacity nor a number
    /// encodes them.
    pub(crate) fn needs_mask(&self) -> bool {
        self.void && !self.alpha && self.metadata.nodata.is_none()
    }
}

/// File format of an image or array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // the names say it
pub enum Format {
    Png,
    /// Lossless. Values without a style are painted in the tree's default style.
    Webp,
    Tiff,
    Exr,
    Npy,
    /// Octrees only.
    Nrrd,
    /// Raw samples without a header.
    Raw,
}

/// Writer of one image from the top down.
pub trait RowWriter {
    /// Writes the next rows: whole rows, pixels from the left, the samples of a pixel together,
    /// little-endian.
    ///
    /// `valid` has a flag per pixel if some may be VOID. PNG images declared as [`ImageSpec::void`]
    /// turn it into their opacity channel, and TIFF files without a nodata number into a mask.
    /// Without flags no pixel is VOID. All other formats rely on the nodata number in `bytes`.
    ///
    /// # Errors
    /// If the bytes are not whole rows, exceed the declared height, or cannot be written.
    fn write_rows(&mut self, bytes: &[u8], valid: Option<&[bool]>) -> Result<()>;

    /// Completes the file and publishes it under its name: see [`Output::commit`].
    ///
    /// # Errors
    /// If it cannot be written, or rows are missing.
    fn finish(self: Box<Self>) -> Result<()>;
}

/// Starts an image.
///
/// # Errors
/// If the format cannot hold such values or that many pixels; the message names a format that can.
pub fn create(output: Output, format: Format, spec: &ImageSpec) -> Result<Box<dyn RowWriter>> {
    if spec.width == 0 || spec.height == 0 {
        let found = format!("{} x {} pixels", spec.width, spec.height);
        return Err(Error::invalid("image size", found, "at least one pixel"));
    }
    match format {
        Format::Png => png::create(output, spec),
        Format::Webp => webp::create(output, spec),
        Format::Tiff => tiff::create(output, spec),
        Format::Exr => exr::create(output, spec),
        Format::Npy => npy::create(output, spec),
        Format::Nrrd => {
            let found = "an image in an NRRD file";
            Err(Error::unsupported(output.path(), found, "NRRD files have volumes; write .npy, .raw or .tif"))
        }
        Format::Raw => raw::create(output, spec),
    }
}

/// Counts the rows that were written.
struct Rows {
    row_bytes: u64,
    missing: u64,
}

impl Rows {
    fn new(spec: &ImageSpec) -> Rows {
        Rows { row_bytes: spec.width * spec.value.size() as u64, missing: spec.height }
    }

    /// Returns the number of rows in `bytes`, which are about to be written.
    fn take(&mut self, bytes: &[u8]) -> Result<u64> {
        let (rows, rest) = (bytes.len() as u64 / self.row_bytes, bytes.len() as u64 % self.row_bytes);
        if rest > 0 || rows > self.missing {
            let expected = format!("whole rows of {} bytes, at most {}", self.row_bytes, self.missing);
            return Err(Error::invalid("rows to write", format!("{} bytes", bytes.len()), expected));
        }
        self.missing -= rows;
        Ok(rows)
    }

    fn finish(&self) -> Result<()> {
        if self.missing == 0 {
            return Ok(());
        }
        Err(Error::invalid("rows to write", format!("{} too few", self.missing), "all rows"))
    }
}

/// Returns the format for a file name, by its extension.
pub fn format_of(path: &Path) -> Option<Format> {
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    Some(match extension.as_str() {
        "png" => Format::Png,
        "webp" => Format::Webp,
        "tif" | "tiff" => Format::Tiff,
        "exr" => Format::Exr,
        "npy" => Format::Npy,
        "nrrd" => Format::Nrrd,
        "raw" | "bin" => Format::Raw,
        _ => return None,
    })
}

//! Pictures and arrays, written row by row.

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

/// Size, samples and metadata of a picture to be written.
#[derive(Clone, Debug)]
pub struct ImageSpec {
    /// Columns.
    pub width: u64,
    /// Rows.
    pub height: u64,
    /// Samples of a pixel.
    pub value: ValueType,
    /// Whether the last sample is opacity.
    pub alpha: bool,
    /// Whether pixels may be VOID. PNG then gets an opacity channel if it has none (or, with a palette, uses
    /// `nodata` if that is a value, and else writes colours).
    pub void: bool,
    /// Descriptions of the picture, for formats that can keep it. Frame and control points are those of the
    /// pixels; nodata is the number that VOID pixels have in every channel of the rows that are written.
    pub metadata: Metadata,
}

impl ImageSpec {
    /// Whether a TIFF file needs a mask for VOID pixels, since neither opacity nor a number encodes them.
    pub(crate) fn needs_mask(&self) -> bool {
        self.void && !self.alpha && self.metadata.nodata.is_none()
    }
}

/// A file format, chosen by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // the names say it
pub enum Format {
    Png,
    /// Without loss. What is not painted is painted in the tree's default style.
    Webp,
    Tiff,
    Exr,
    Npy,
    /// Octrees alone.
    Nrrd,
    /// The samples, nothing else.
    Raw,
}

/// Writes one picture from the top down.
pub trait RowWriter {
    /// Writes the next rows: whole rows, pixels from the left, a pixel's samples together, little-endian.
    ///
    /// `valid` has a flag per pixel where some may be VOID: PNG pictures announced as [`ImageSpec::void`]
    /// make their opacity channel of it, and TIFF files without a nodata number a mask (no flags: nothing is VOID); all others rely on the
    /// nodata number being in `bytes` already.
    ///
    /// # Errors
    /// If the bytes are no whole rows, are more than announced, or cannot be written.
    fn write_rows(&mut self, bytes: &[u8], valid: Option<&[bool]>) -> Result<()>;

    /// Completes the file and publishes it under its name: see [`Output::commit`].
    ///
    /// # Errors
    /// If it cannot be written. If fewer rows than announced were written, that is an error too.
    fn finish(self: Box<Self>) -> Result<()>;
}

/// Starts a picture.
///
/// # Errors
/// If the format cannot hold such values or so many pixels; the message says which format can.
pub fn create(output: Output, format: Format, spec: &ImageSpec) -> Result<Box<dyn RowWriter>> {
    if spec.width == 0 || spec.height == 0 {
        let found = format!("{} x {} pixels", spec.width, spec.height);
        return Err(Error::invalid("picture size", found, "at least one pixel"));
    }
    match format {
        Format::Png => png::create(output, spec),
        Format::Webp => webp::create(output, spec),
        Format::Tiff => tiff::create(output, spec),
        Format::Exr => exr::create(output, spec),
        Format::Npy => npy::create(output, spec),
        Format::Nrrd => {
            let found = "a picture in an NRRD file";
            Err(Error::unsupported(output.path(), found, "octrees are written so; write .npy, .raw or .tif"))
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

    /// The number of rows in `bytes`, which are about to be written.
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
        Err(Error::invalid("picture", format!("{} rows too few", self.missing), "all rows"))
    }
}

/// The format for a file name, by its extension.
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

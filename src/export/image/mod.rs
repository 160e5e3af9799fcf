//! Pictures and arrays, written row by row.

use std::path::Path;

use crate::space::Frame;
use crate::store::Output;
use crate::value::{Palette, ValueType};
use crate::{Error, Result};

/// What a picture to be written looks like.
#[derive(Clone, Debug)]
pub struct ImageSpec {
    /// Columns.
    pub width: u64,
    /// Rows.
    pub height: u64,
    /// Samples of a pixel.
    pub value: ValueType,
    /// Where the pixels lie, for formats that can tell.
    pub frame: Option<Frame>,
    /// The number that VOID pixels have in every channel of the rows that are written, for formats that can
    /// mark it.
    pub nodata: Option<f64>,
    /// Colours of the values, for formats that can keep them.
    pub palette: Option<Palette>,
    /// Names of the channels.
    pub band_names: Vec<String>,
}

/// A file format, chosen by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // the names say it
pub enum Format {
    Png,
    Tiff,
    Exr,
    Npy,
    /// The samples, nothing else.
    Raw,
}

/// Writes one picture from the top down.
pub trait RowWriter {
    /// Writes the next rows: whole rows, pixels from the left, a pixel's samples together, little-endian.
    /// `valid` has a flag per pixel where some may be VOID: formats with an opacity channel use it, the others
    /// rely on the nodata number being in `bytes` already.
    fn write_rows(&mut self, bytes: &[u8], valid: Option<&[bool]>) -> Result<()>;

    /// Completes the file and puts it in its place.
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
    let _ = (format, spec);
    Err(Error::unsupported(output.path(), "this format", "write .tif"))
}

/// The format for a file name, by its extension.
pub fn format_of(path: &Path) -> Option<Format> {
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    Some(match extension.as_str() {
        "png" => Format::Png,
        "tif" | "tiff" => Format::Tiff,
        "exr" => Format::Exr,
        "npy" => Format::Npy,
        "raw" | "bin" => Format::Raw,
        _ => return None,
    })
}

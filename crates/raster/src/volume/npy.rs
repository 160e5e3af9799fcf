//! Volumes in NPY files.

use std::fs::File;
use std::io::Seek;
use std::path::Path;

use super::array::{Array, ArrayLayout};
use super::{OpenedVolume, Samples};
use crate::import::SampleFormat;
use spinney_base::{Error, Result};
use spinney_container::Metadata;
use spinney_records::npy::NpyHeader;

/// The sample format of a type name, and whether it is big-endian.
fn sample_format(descr: &str) -> Option<(SampleFormat, bool)> {
    let (order, name) = descr.split_at_checked(1)?;
    let format = match name {
        "b1" | "u1" => SampleFormat::Uint(8),
        "u2" => SampleFormat::Uint(16),
        "u4" => SampleFormat::Uint(32),
        "u8" => SampleFormat::Uint(64),
        "i1" => SampleFormat::Int(8),
        "i2" => SampleFormat::Int(16),
        "i4" => SampleFormat::Int(32),
        "i8" => SampleFormat::Int(64),
        "f2" => SampleFormat::Float(16),
        "f4" => SampleFormat::Float(32),
        "f8" => SampleFormat::Float(64),
        _ => return None,
    };
    let is_known = matches!(order, "<" | ">") || order == "|" && name.ends_with('1');
    is_known.then_some((format, order == ">"))
}

/// Opens a file and checks that it has all samples that its header declares.
///
/// # Errors
/// If it cannot be read, is not a three-dimensional array, or has another length.
pub(super) fn open(path: &Path) -> Result<OpenedVolume> {
    let mut file = File::open(path).map_err(Error::io(path, "open"))?;
    let header = NpyHeader::read(&mut file, path)?;
    let descr = header.samples(path)?;
    let start = file.stream_position().map_err(Error::io(path, "read"))?;
    let unsupported = |found: String, advice: &str| Err(Error::unsupported(path, found, advice));
    if header.fortran_order {
        let advice = "save it in C order: numpy.save(path, numpy.ascontiguousarray(array))";
        return unsupported("an array in Fortran order".into(), advice);
    }
    let shape = header.shape_text();
    let (size, channels) = match header.shape[..] {
        [z, y, x] => ([x, y, z], 1),
        [z, y, x, channels @ 1..=4] => ([x, y, z], channels as u8),
        _ => {
            let advice = "volumes have the dimensions z, y, x, or z, y, x and up to 4 channels; save a plane as \
                          array[None], an image as TIFF or PNG; for points use `--index points`";
            return unsupported(format!("an array of shape {shape}"), advice);
        }
    };
    let Some((format, is_big_endian)) = sample_format(descr) else {
        let advice = "convert it with array.astype, to bool, or to integers or floats of at most 8 bytes";
        return unsupported(format!("an array of type `{}`", descr.escape_debug()), advice);
    };
    let layout = ArrayLayout { size, format, channels, is_big_endian };
    layout.check(path)?;
    let Some(end) = layout.bytes().and_then(|bytes| bytes.checked_add(start)) else {
        let found = format!("shape {shape}");
        return Err(Error::corrupt(
            path,
            "the header",
            found,
            "a shape whose size in bytes is a 64-bit number",
        ));
    };
    let length = file.metadata().map_err(Error::io(path, "read its size"))?.len();
    if length != end {
        let expected = format!("{end} for an array of shape {shape} of `{descr}`");
        return Err(Error::corrupt(path, "the whole file", format!("{length} bytes"), expected));
    }
    Ok(OpenedVolume {
        words: format!("NPY of {descr}"),
        stored: format.name(),
        layout,
        metadata: Metadata::default(),
        kind: None,
        samples: Samples::Array(Array::new(path, file, layout, start)),
    })
}

//! Volumes in files of raw samples, whose layout the caller provides.

use std::path::Path;

use super::array::{Array, ArrayLayout};
use super::{OpenedVolume, Samples};
use crate::import::SampleFormat;
use serde::{Deserialize, Serialize};
use spinney_base::io::open_input;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};
use spinney_container::Metadata;

/// Layout of a file without a header: contiguous samples, those of a cell together, x fastest, then
/// y, then z.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct RawLayout {
    /// Cells along x, y and z.
    pub size: [u64; 3],
    /// Type of the samples.
    pub sample: SampleType,
    /// Samples per cell, at most 4.
    pub channels: u8,
    /// Whether the most significant byte of a sample comes first.
    pub is_big_endian: bool,
    /// Bytes of the file before the first sample.
    pub skip: u64,
}

impl RawLayout {
    /// One little-endian sample per cell, from the first byte on.
    pub fn new(size: [u64; 3], sample: SampleType) -> RawLayout {
        RawLayout { size, sample, channels: 1, is_big_endian: false, skip: 0 }
    }
}

/// Opens a file and checks its length.
///
/// # Errors
/// If it cannot be read, has another length, or trees do not support such cells.
pub(super) fn open(path: &Path, raw: &RawLayout) -> Result<OpenedVolume> {
    let file = open_input(path)?;
    let RawLayout { size: [x, y, z], sample, channels, is_big_endian, skip } = *raw;
    let format = match (sample.is_float(), sample) {
        (true, _) => SampleFormat::Float(8 * sample.size() as u8),
        (false, SampleType::I8 | SampleType::I16 | SampleType::I32 | SampleType::I64) => {
            SampleFormat::Int(8 * sample.size() as u8)
        }
        _ => SampleFormat::Uint(8 * sample.size() as u8),
    };
    let layout = ArrayLayout { size: raw.size, format, channels, is_big_endian };
    layout.check(path)?;
    let length = file.metadata().map_err(Error::io(path, "read its size"))?.len();
    let text = format!("{x} x {y} x {z} cells of {channels} samples of {} after {skip} bytes", sample.name());
    match layout.bytes().and_then(|bytes| bytes.checked_add(skip)) {
        Some(end) if end == length => {}
        Some(end) => {
            let found = format!("{length} bytes");
            return Err(Error::corrupt(path, "the whole file", found, format!("{end} for {text}")));
        }
        None => return Err(Error::invalid("raw layout", text, "a size in bytes that is a 64-bit number")),
    }
    let order = match (sample.size(), is_big_endian) {
        (1, _) => "",
        (_, true) => ", big-endian",
        (_, false) => ", little-endian",
    };
    Ok(OpenedVolume {
        words: format!("raw samples{order}"),
        stored: format.name(),
        layout,
        metadata: Metadata::default(),
        kind: None,
        samples: Samples::Array(Array::new(path, file, layout, skip)),
    })
}

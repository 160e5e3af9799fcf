//! Volumes in NRRD files ("nearly raw raster data"): a text header, and samples after it or in a
//! separate data file.

mod field;
mod frame_fields;
mod header;
#[cfg(test)]
mod tests;
mod write;

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use flate2::read::MultiGzDecoder;

use self::header::{Encoding, Header};
pub(crate) use self::write::nrrd_head;
use super::array::{Array, ArrayLayout};
use super::spill::BoxSpill;
use super::{OpenedVolume, Samples};
use spinney_base::io::{FileAccess, open_input};
use spinney_base::space::Bounds;
use spinney_base::{Error, Progress, Result};

/// The first bytes of every NRRD file; the format version follows.
pub(super) const MAGIC: &[u8] = b"NRRD000";

/// Maximum expansion of a byte of a gzip stream.
const MAX_GROWTH: u64 = 1032;
/// Bytes decompressed at a time.
const PART: usize = 1 << 20;

/// Whether a file is NRRD, by its first bytes.
pub(super) fn is_one(path: &Path) -> bool {
    let mut start = [0; MAGIC.len()];
    File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok() && start == *MAGIC
}

/// Opens a file and checks that it has all samples that its header declares, as far as possible
/// without decompression.
///
/// # Errors
/// If the file cannot be read, is no volume, violates the format, uses an unsupported feature or is
/// too short, or if it has a data file and `access` refuses that.
pub(super) fn open(path: &Path, access: &FileAccess) -> Result<OpenedVolume> {
    let mut file = BufReader::new(open_input(path)?);
    let header = Header::read(&mut file, path)?;
    let (data, mut input) = match header.detached_data(path) {
        None => (path.to_path_buf(), file),
        Some(data) => {
            access.check_external(path, &data)?;
            let input = BufReader::new(open_input(&data)?);
            (data, input)
        }
    };
    let layout = header.layout;
    layout.check(path)?;
    let [x, y, z] = layout.size;
    let text = format!("{x} x {y} x {z} cells of {} samples of {}", layout.channels, layout.format.name());
    let Some(bytes) = layout.bytes() else {
        return Err(Error::corrupt(path, "header", text, "a size in bytes that is a 64-bit number"));
    };
    let failed = || Error::io(&data, "read");
    for line in 0..header.line_skip {
        if input.skip_until(b'\n').map_err(failed())? == 0 {
            let found = format!("{line} lines");
            return Err(Error::corrupt(
                &data,
                "the whole file",
                found,
                format!("{} lines to skip", header.line_skip),
            ));
        }
    }
    let start = input.stream_position().map_err(failed())?;
    let length = input.get_ref().metadata().map_err(Error::io(&data, "read its size"))?.len();
    let there = length.saturating_sub(start);
    let (samples, encoding) = match header.encoding {
        Encoding::Raw => {
            // Samples at the end of the file are preceded by whatever else it has.
            let skip = header.byte_skip.unwrap_or(there.saturating_sub(bytes));
            let Some(start) = start
                .checked_add(skip)
                .filter(|start| start.checked_add(bytes).is_some_and(|end| end <= length))
            else {
                let found = format!("{there} bytes after the header");
                let expected = format!("{bytes} for {text}, and {skip} before them");
                return Err(Error::corrupt(&data, "the samples", found, expected));
            };
            (Samples::Array(Array::new(&data, input.into_inner(), layout, start)), "raw")
        }
        Encoding::Gzip => {
            let skip = header.byte_skip.unwrap_or(0);
            if bytes.checked_add(skip).is_none_or(|whole| whole / MAX_GROWTH > there) {
                let found = format!("{there} compressed bytes");
                let expected = format!("data for {bytes} bytes of {text}, and {skip} before them");
                return Err(Error::corrupt(&data, "the samples", found, expected));
            }
            (
                Samples::Packed(Box::new(Packed {
                    path: data,
                    file: input.into_inner(),
                    start,
                    skip,
                    bytes,
                    layout,
                })),
                "gzip",
            )
        }
    };
    Ok(OpenedVolume {
        words: format!("NRRD of {}, {encoding}", header.kind_words),
        stored: layout.format.name(),
        layout,
        metadata: header.metadata,
        kind: None,
        samples,
    })
}

/// Returns the data file, if the samples are not in the file of the header.
///
/// # Errors
/// If the header cannot be read or violates the format.
pub(super) fn data_file(path: &Path) -> Result<Option<PathBuf>> {
    let header = Header::read(&mut BufReader::new(open_input(path)?), path)?;
    Ok(header.detached_data(path))
}

/// Samples in a compressed stream.
pub(super) struct Packed {
    path: PathBuf,
    file: File,
    /// Bytes before the stream, and decompressed bytes before the samples.
    start: u64,
    skip: u64,
    /// Bytes of the samples.
    bytes: u64,
    layout: ArrayLayout,
}

impl Packed {
    /// Decompresses the samples of a box into a temporary file in a directory. At most the declared
    /// samples are decompressed, whatever the stream has. Samples after the box are not read.
    ///
    /// # Errors
    /// If the stream is corrupt or too short, or, if the box includes the last sample, too long.
    pub(super) fn unpack(
        mut self,
        cells: Bounds,
        directory: &Path,
        progress: &dyn Progress,
    ) -> Result<Array> {
        let corrupt = |error: std::io::Error| match error.kind() {
            std::io::ErrorKind::Interrupted | std::io::ErrorKind::PermissionDenied => {
                Error::io(&self.path, "read")(error)
            }
            _ => Error::corrupt(&self.path, "the samples", error.to_string(), "a compressed stream (gzip)"),
        };
        self.file.seek(SeekFrom::Start(self.start)).map_err(Error::io(&self.path, "read"))?;
        let mut stream = MultiGzDecoder::new(BufReader::with_capacity(1 << 16, &self.file));
        let mut out = BoxSpill::new(self.layout, cells, directory)?;
        let mut part = vec![0; PART];
        // One byte more than declared, to detect a longer stream.
        let is_last = out.end() == self.bytes;
        let (mut at, end) = (0, self.skip + out.end() + u64::from(is_last));
        while at < end {
            progress.check()?;
            let most = (end - at).min(PART as u64) as usize;
            let count = stream.read(&mut part[..most]).map_err(corrupt)?;
            if count == 0 {
                break;
            }
            let samples = self.skip.saturating_sub(at).min(count as u64) as usize;
            let inside = (self.skip + self.bytes).saturating_sub(at).min(count as u64) as usize;
            let samples = samples.min(inside);
            out.write((at + samples as u64).saturating_sub(self.skip), &part[samples..inside])?;
            at += count as u64;
        }
        if at + u64::from(is_last) != end {
            let found = if at == end { "more bytes".into() } else { format!("{at} bytes") };
            let expected = format!("{} bytes, as declared by the header", self.skip + self.bytes);
            return Err(Error::corrupt(&self.path, "the samples", found, expected));
        }
        out.finish(&self.path)
    }
}

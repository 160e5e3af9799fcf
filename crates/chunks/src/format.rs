//! How chunks are stored, and their decoding.

use serde::{Deserialize, Serialize};

use crate::copy::set_len;
use crate::{Colour, Compression, DecoderStates, Predictor, SampleFormat};
use crate::{codec, predictor};

/// Maximum number of columns or rows of a chunk.
const MAX_SIDE: u64 = i32::MAX as u64;
/// Maximum number of samples per pixel.
const MAX_SAMPLES: usize = u16::MAX as usize;
/// Maximum number of columns or rows of a chunk of a fax.
const MAX_FAX_SIDE: u64 = u16::MAX as u64;

/// How the chunks of an image are stored.
///
/// Methods other than [`check`](ChunkFormat::check) expect a format that passes it, and may panic
/// otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChunkFormat {
    /// Columns of a full chunk.
    pub chunk_width: u64,
    /// Rows of a full chunk.
    pub chunk_height: u64,
    /// Samples per pixel in the file.
    pub samples: usize,
    /// Number of planes with chunks of their own: 1, or `samples`.
    pub planes: usize,
    /// The samples; 8-bit unsigned integers if colours are converted.
    pub sample_format: SampleFormat,
    /// Compression of each chunk.
    pub compression: Compression,
    /// Filter before compression.
    pub predictor: Predictor,
    /// Conversion after decompression.
    pub colour: Colour,
    /// Whether the most significant byte of a sample comes first.
    pub big_endian: bool,
    /// Whether bits are in bytes from the lowest up.
    pub lowest_first: bool,
}

impl ChunkFormat {
    /// Samples per pixel after colour conversion.
    pub fn channels(&self) -> usize {
        self.colour.channels(self.samples)
    }

    /// Bytes of a decoded, widened pixel with all channels.
    pub fn pixel_bytes(&self) -> usize {
        self.sample_format.sample().size() * self.channels()
    }

    /// Bytes of the samples of a full chunk, as stored without compression. Subsampled colour takes
    /// fewer.
    pub fn chunk_bytes(&self) -> u64 {
        self.row_bytes(self.chunk_samples()).saturating_mul(self.chunk_height)
    }

    /// Maximum number of bytes of a stored chunk. Codecs enlarge what they cannot compress, by less
    /// than this.
    pub fn max_stored_bytes(&self) -> u64 {
        self.chunk_bytes().saturating_mul(2).saturating_add(1 << 16)
    }

    /// Bytes that a chunk of `rows` rows decompresses to, and its bytes after colour conversion.
    /// Saturates, so that a format that fails [`check`](ChunkFormat::check) never yields a short
    /// buffer.
    pub fn decoded_bytes(&self, rows: usize) -> (usize, usize) {
        let (packed_rows, packed_row_bytes) = self.packed(rows);
        (packed_rows.saturating_mul(packed_row_bytes), self.converted_row_bytes().saturating_mul(rows))
    }

    /// Name of the compression, if this build cannot decode it.
    pub fn unsupported(&self) -> Option<&'static str> {
        (!codec::supports(&self.compression)).then(|| self.compression.name())
    }

    /// Name and version of the decoder, such as "zune-jpeg 0.5.15", if the compression is lossy:
    /// other decoders may return other samples.
    pub fn lossy_decoder(&self) -> Option<&'static str> {
        self.compression.lossy_decoder()
    }

    /// Checks a format of unknown origin: all that decoding indexes with or multiplies by must be
    /// in range. Memory is not checked: compare it with [`ChunkFormat::chunk_bytes`].
    ///
    /// # Errors
    /// Describes what is wrong.
    pub fn check(&self) -> Result<(), String> {
        let ChunkFormat { chunk_width, chunk_height, samples, planes, sample_format, .. } = *self;
        let name = self.compression.name();
        for (side, what) in [(chunk_width, "columns"), (chunk_height, "rows")] {
            if !(1..=MAX_SIDE).contains(&side) {
                return Err(format!("chunks of {side} {what}, not 1 to {MAX_SIDE}"));
            }
        }
        if !(1..=MAX_SAMPLES).contains(&samples) {
            return Err(format!("{samples} samples per pixel, not 1 to {MAX_SAMPLES}"));
        }
        if planes != 1 && planes != samples {
            return Err(format!("{planes} planes of {samples} samples per pixel"));
        }
        sample_format.check()?;
        let bits = sample_format.bits();
        let filtered = match self.predictor {
            Predictor::None => true,
            _ if !self.compression.has_predictor() => false,
            Predictor::Horizontal => matches!(bits, 8 | 16 | 32 | 64),
            Predictor::Float => matches!(sample_format, SampleFormat::Float(_)),
        };
        if !filtered {
            let samples = sample_format.name();
            return Err(format!("predictor {} for {samples} samples, {name}", self.predictor.number()));
        }
        match self.compression {
            Compression::Jpeg(_) | Compression::WebP if bits != 8 => {
                return Err(format!("{name} of {} samples", sample_format.name()));
            }
            Compression::Fax4 if (sample_format, samples) != (SampleFormat::Uint(1), 1) => {
                return Err(format!("fax of {samples} {} samples", sample_format.name()));
            }
            Compression::Fax4 if chunk_width.max(chunk_height) > MAX_FAX_SIDE => {
                return Err(format!("fax of more than {MAX_FAX_SIDE} columns or rows"));
            }
            _ => {}
        }
        if self.lowest_first && self.compression.ignores_fill_order() {
            return Err(format!("{name} with reversed bits"));
        }
        self.colour.check(self)?;
        self.check_size()
    }

    /// Whether bits of a row and bytes of a chunk can be counted in a `usize`.
    fn check_size(&self) -> Result<(), String> {
        let row_bytes = self.row_bytes(self.chunk_samples());
        let (packed_rows, packed_row_bytes) =
            self.colour.packed(self.chunk_width, self.chunk_height, row_bytes);
        let widened = self.chunk_width.saturating_mul(self.pixel_bytes() as u64);
        let needed = [
            row_bytes.saturating_mul(8),
            packed_rows.saturating_mul(packed_row_bytes),
            self.row_bytes(self.converted_samples()).saturating_mul(self.chunk_height),
            widened,
        ];
        if needed.iter().all(|needed| *needed <= isize::MAX as u64) {
            return Ok(());
        }
        let pixels = format!("{}x{} pixels", self.chunk_width, self.chunk_height);
        Err(format!("chunks of {pixels} of {} samples, which exceed the address space", self.samples))
    }

    /// Decodes a chunk of `rows` rows into `chunk`, which is resized: decompression, bit order,
    /// predictor, colour conversion. `raw` has the stored bytes, which may be changed; if there is
    /// no compression, more bytes may follow.
    ///
    /// # Errors
    /// Describes what is wrong with the stored bytes.
    pub fn decode(
        &self,
        states: &mut DecoderStates,
        raw: &mut [u8],
        rows: usize,
        chunk: &mut Vec<u8>,
    ) -> Result<(), String> {
        if !(1..=self.chunk_height).contains(&(rows as u64)) {
            return Err(format!("{rows} rows of chunks of {} rows", self.chunk_height));
        }
        set_len(chunk, self.decoded_bytes(rows).0);
        if self.lowest_first {
            raw.iter_mut().for_each(|byte| *byte = byte.reverse_bits());
        }
        codec::decompress(self, states, raw, rows, chunk)?;
        self.finish(chunk, rows);
        Ok(())
    }

    /// The steps of [`ChunkFormat::decode`] for a chunk without compression, in place. `chunk` has
    /// as many bytes as the first number of [`ChunkFormat::decoded_bytes`].
    pub fn restore(&self, chunk: &mut Vec<u8>, rows: usize) {
        if self.lowest_first {
            chunk.iter_mut().for_each(|byte| *byte = byte.reverse_bits());
        }
        self.finish(chunk, rows);
    }

    /// Restores byte order and samples (predictor, colour conversion) of a decompressed chunk.
    fn finish(&self, chunk: &mut Vec<u8>, rows: usize) {
        let samples = self.chunk_samples();
        if let Some(size) = self.sample_format.bytes() {
            let (_, row_bytes) = self.packed(rows);
            predictor::restore(self.predictor, chunk, row_bytes, size, samples, self.big_endian);
        }
        self.colour.convert(chunk, self.chunk_width as usize, rows, samples);
    }

    /// Samples per pixel in each chunk.
    pub(crate) fn chunk_samples(&self) -> usize {
        if self.planes > 1 { 1 } else { self.samples }
    }

    /// Returns the number of samples of a chunk's pixel after colour conversion.
    fn converted_samples(&self) -> usize {
        if self.planes > 1 { 1 } else { self.channels() }
    }

    /// Bytes of a row of a chunk with some samples per pixel.
    fn row_bytes(&self, samples: usize) -> u64 {
        let pixel_bits = (samples as u64).saturating_mul(self.sample_format.bits() as u64);
        self.chunk_width.saturating_mul(pixel_bits).div_ceil(8)
    }

    /// Bytes of a row of a chunk after colour conversion.
    pub(crate) fn converted_row_bytes(&self) -> usize {
        saturated(self.row_bytes(self.converted_samples()))
    }

    /// Rows and bytes per row of a chunk of `rows` rows before colour conversion.
    pub(crate) fn packed(&self, rows: usize) -> (usize, usize) {
        let row_bytes = self.row_bytes(self.chunk_samples());
        let (rows, row_bytes) = self.colour.packed(self.chunk_width, rows as u64, row_bytes);
        (saturated(rows), saturated(row_bytes))
    }
}

fn saturated(bytes: u64) -> usize {
    usize::try_from(bytes).unwrap_or(usize::MAX)
}

//! Coding of TIFF strips and tiles: prediction, then compression.

use std::io::Write;

use flate2::Compression as DeflateLevel;
use flate2::write::ZlibEncoder;

use spinney_base::value::ValueType;
use spinney_chunks::Predictor;
use spinney_chunks::spec::compression;

/// Lossless compression of strips or tiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Coder {
    Uncompressed,
    Deflate { level: u32 },
    Zstd { level: i32 },
}

impl Coder {
    /// Value of the compression tag.
    pub(crate) fn number(self) -> u16 {
        let number = match self {
            Coder::Uncompressed => compression::NONE,
            Coder::Deflate { .. } => compression::ADOBE_DEFLATE,
            Coder::Zstd { .. } => compression::ZSTD,
        };
        number as u16
    }

    /// Compresses bytes.
    pub(crate) fn compress(self, bytes: Vec<u8>) -> Vec<u8> {
        match self {
            Coder::Uncompressed => bytes,
            Coder::Deflate { level } => {
                let buffer = Vec::with_capacity(bytes.len() / 2);
                let mut encoder = ZlibEncoder::new(buffer, DeflateLevel::new(level));
                encoder
                    .write_all(&bytes)
                    .and_then(|()| encoder.finish())
                    .expect("writing to a Vec cannot fail")
            }
            Coder::Zstd { level } => {
                zstd::bulk::compress(&bytes, level).expect("the output buffer has the maximum size")
            }
        }
    }
}

/// Coding of rows of samples into a strip or tile.
#[derive(Clone, Copy)]
pub(crate) struct Coding {
    pub(crate) coder: Coder,
    pub(crate) predictor: Predictor,
    sample: usize,
    channels: usize,
    pub(crate) row_bytes: usize,
}

impl Coding {
    /// A coding for rows of `row_bytes` bytes. There is no prediction for `labels`, whose
    /// differences mean nothing, or without compression.
    pub(crate) fn new(value: ValueType, row_bytes: usize, labels: bool, coder: Coder) -> Coding {
        let predictor = match value.sample {
            _ if labels || coder == Coder::Uncompressed => Predictor::None,
            sample if sample.is_float() => Predictor::Float,
            _ => Predictor::Horizontal,
        };
        Coding {
            coder,
            predictor,
            sample: value.sample.size(),
            channels: usize::from(value.channels),
            row_bytes,
        }
    }

    /// Encodes a strip or tile.
    pub(crate) fn compress(&self, mut rows: Vec<u8>) -> Vec<u8> {
        if self.predictor != Predictor::None {
            rows.chunks_exact_mut(self.row_bytes).for_each(|row| self.predict(row));
        }
        self.coder.compress(rows)
    }

    fn predict(&self, row: &mut [u8]) {
        let samples = self.row_bytes / self.sample;
        match (self.predictor, self.sample) {
            (Predictor::None, _) => {}
            (Predictor::Float, _) => {
                // Adobe's predictor 3 (TIFF Technical Note 3): the most significant bytes of all
                // samples in the row come first, and so on; then differences of bytes at a distance
                // of one pixel.
                let mut planes = vec![0; row.len()];
                for (i, sample) in row.chunks_exact(self.sample).enumerate() {
                    for (weight, byte) in sample.iter().rev().enumerate() {
                        planes[weight * samples + i] = *byte;
                    }
                }
                row.copy_from_slice(&planes);
                differences(row, self.channels);
            }
            (Predictor::Horizontal, 1) => differences(row, self.channels),
            (Predictor::Horizontal, 2) => {
                let row = row.as_chunks_mut::<2>().0;
                for i in (self.channels..samples).rev() {
                    let left = u16::from_le_bytes(row[i - self.channels]);
                    row[i] = u16::from_le_bytes(row[i]).wrapping_sub(left).to_le_bytes();
                }
            }
            (Predictor::Horizontal, 8) => {
                let row = row.as_chunks_mut::<8>().0;
                for i in (self.channels..samples).rev() {
                    let left = u64::from_le_bytes(row[i - self.channels]);
                    row[i] = u64::from_le_bytes(row[i]).wrapping_sub(left).to_le_bytes();
                }
            }
            (Predictor::Horizontal, _) => {
                let row = row.as_chunks_mut::<4>().0;
                for i in (self.channels..samples).rev() {
                    let left = u32::from_le_bytes(row[i - self.channels]);
                    row[i] = u32::from_le_bytes(row[i]).wrapping_sub(left).to_le_bytes();
                }
            }
        }
    }
}

/// Subtracts from each byte the byte `distance` before it. Runs backwards, so that the subtrahend
/// is still the original.
fn differences(bytes: &mut [u8], distance: usize) {
    for i in (distance..bytes.len()).rev() {
        bytes[i] = bytes[i].wrapping_sub(bytes[i - distance]);
    }
}

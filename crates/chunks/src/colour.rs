//! Conversion of colour spaces to RGB, for the same spaces as in GDAL.

use serde::{Deserialize, Serialize};

use crate::{ChunkFormat, Compression, Predictor, SampleFormat};

/// Conversion of a decoded chunk's samples to RGB; all except `Keep` require 8-bit samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Colour {
    /// No conversion.
    Keep,
    /// JPEG's luma and chroma; chroma is already upsampled.
    Jpeg,
    /// Subsampled luma and chroma: blocks of this many columns and rows of luma share a pair of
    /// chroma samples.
    Blocks(Yuv, usize, usize),
    /// Cyan, magenta, yellow, black and optional extra samples become red, green, blue and full
    /// opacity.
    Cmyk,
}

/// Shares of red, green and blue in luma.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Yuv([f32; 3]);

/// Weights of chroma in red, green (two) and blue, with 16 fractional bits.
#[derive(Clone, Copy)]
struct Weights {
    red: i32,
    green_cr: i32,
    green_cb: i32,
    blue: i32,
}

impl Yuv {
    /// Luma with these shares of red, green and blue.
    pub fn new(shares: [f32; 3]) -> Yuv {
        Yuv(shares)
    }

    fn weights(self) -> Weights {
        let Yuv([red, green, blue]) = self;
        let fixed = |weight: f32| (weight.clamp(0.0, 2.0) * 65536.0 + 0.5) as i32;
        let (r, b) = (2.0 - 2.0 * red, 2.0 - 2.0 * blue);
        Weights {
            red: fixed(r),
            green_cr: fixed(red * r / green),
            green_cb: fixed(blue * b / green),
            blue: fixed(b),
        }
    }
}

impl Weights {
    /// Weights of the JPEG file format.
    const JPEG: Weights = Weights { red: 91881, green_cr: 46802, green_cb: 22554, blue: 116130 };

    fn rgb(self, [y, cb, cr]: [u8; 3]) -> [u8; 3] {
        let (y, cb, cr) = (y as i32, cb as i32 - 128, cr as i32 - 128);
        let rounded = |sum: i32| (sum + (1 << 15)) >> 16;
        [
            y + rounded(self.red * cr),
            y + rounded(-self.green_cb * cb - self.green_cr * cr),
            y + rounded(self.blue * cb),
        ]
        .map(|c| c.clamp(0, 255) as u8)
    }
}

impl Colour {
    /// Samples per pixel after the conversion.
    pub(crate) fn channels(self, samples: usize) -> usize {
        if self == Colour::Cmyk { 4 } else { samples }
    }

    /// Checks the conversion of a format of unknown origin.
    pub(crate) fn check(self, format: &ChunkFormat) -> Result<(), String> {
        let ChunkFormat { samples, planes, ref compression, .. } = *format;
        let jpeg = matches!(compression, Compression::Jpeg(_));
        let fits = match self {
            Colour::Keep => return Ok(()),
            Colour::Jpeg => samples == 3 && jpeg,
            Colour::Blocks(Yuv(shares), h, v) => {
                if ![h, v].iter().all(|side| matches!(side, 1 | 2 | 4)) {
                    return Err(format!("chroma for blocks of {h}x{v} pixels, not 1, 2 or 4 each"));
                }
                if !shares.iter().all(|share| share.is_finite()) || shares[1] == 0.0 {
                    return Err(format!("shares of colours in luma of {shares:?}"));
                }
                if format.predictor != Predictor::None {
                    return Err("subsampled colour with a predictor".into());
                }
                samples == 3 && !jpeg && *compression != Compression::WebP
            }
            Colour::Cmyk => samples >= 4,
        };
        if fits && planes == 1 && format.sample_format == SampleFormat::Uint(8) {
            return Ok(());
        }
        let name = match self {
            Colour::Cmyk => "CMYK",
            _ => "YCbCr",
        };
        Err(format!(
            "{name} colour in {planes} planes of {samples} {} samples, {}",
            format.sample_format.name(),
            compression.name()
        ))
    }

    /// Rows and bytes per row of the compressed form of a chunk with `width` columns.
    pub(crate) fn packed(self, width: u64, rows: u64, row_bytes: u64) -> (u64, u64) {
        match self {
            Colour::Blocks(_, h, v) => {
                let (h, v) = (h as u64, v as u64);
                (rows.div_ceil(v), width.div_ceil(h) * (h * v + 2))
            }
            _ => (rows, row_bytes),
        }
    }

    /// Converts a decoded chunk of `width` columns and `rows` rows.
    pub(crate) fn convert(self, chunk: &mut Vec<u8>, width: usize, rows: usize, samples: usize) {
        match self {
            Colour::Keep => {}
            Colour::Jpeg => {
                for pixel in chunk.as_chunks_mut::<3>().0 {
                    *pixel = Weights::JPEG.rgb(*pixel);
                }
            }
            Colour::Blocks(yuv, h, v) => {
                let weights = yuv.weights();
                let mut rgb = vec![0; width * rows * 3];
                let across = width.div_ceil(h);
                for (i, block) in chunk.chunks_exact(h * v + 2).enumerate() {
                    let [cb, cr] = [block[h * v], block[h * v + 1]];
                    for (j, luma) in block[..h * v].iter().enumerate() {
                        let (x, y) = (i % across * h + j % h, i / across * v + j / h);
                        if x < width && y < rows {
                            let at = (y * width + x) * 3;
                            rgb[at..at + 3].copy_from_slice(&weights.rgb([*luma, cb, cr]));
                        }
                    }
                }
                *chunk = rgb;
            }
            Colour::Cmyk => {
                // In place: pixel i is read at `i * samples` >= `4 * i`, where it is written, since
                // `samples >= 4`.
                for i in 0..width * rows {
                    let ink: [u8; 4] = std::array::from_fn(|c| 255 - chunk[i * samples + c]);
                    let light = |c: usize| (ink[3] as u32 * ink[c] as u32 / 255) as u8;
                    chunk[i * 4..i * 4 + 4].copy_from_slice(&[light(0), light(1), light(2), 255]);
                }
                chunk.truncate(width * rows * 4);
            }
        }
    }
}

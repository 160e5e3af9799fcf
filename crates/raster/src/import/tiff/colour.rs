//! Conversion of colour spaces to RGB, for the same spaces as in GDAL.

/// Conversion of a decoded chunk's samples to RGB; all except `Keep` require 8-bit samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Colour {
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

/// Weights of chroma in red, green (two) and blue, with 16 fractional bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Yuv {
    red: i32,
    green_cr: i32,
    green_cb: i32,
    blue: i32,
}

impl Yuv {
    /// Weights of the JPEG file format.
    const JPEG: Yuv = Yuv { red: 91881, green_cr: 46802, green_cb: 22554, blue: 116130 };

    /// The weights for given coefficients of red, green and blue in luma.
    pub(super) fn new([red, green, blue]: [f32; 3]) -> Yuv {
        let fixed = |weight: f32| (weight.clamp(0.0, 2.0) * 65536.0 + 0.5) as i32;
        let (r, b) = (2.0 - 2.0 * red, 2.0 - 2.0 * blue);
        Yuv {
            red: fixed(r),
            green_cr: fixed(red * r / green),
            green_cb: fixed(blue * b / green),
            blue: fixed(b),
        }
    }

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
    pub(super) fn channels(self, samples: usize) -> usize {
        if self == Colour::Cmyk { 4 } else { samples }
    }

    /// Rows and bytes per row of the compressed form of a chunk with `width` columns.
    pub(super) fn packed(self, width: usize, rows: usize, row_bytes: usize) -> (usize, usize) {
        match self {
            Colour::Blocks(_, h, v) => (rows.div_ceil(v), width.div_ceil(h) * (h * v + 2)),
            _ => (rows, row_bytes),
        }
    }

    /// Converts a decoded chunk of `width` columns and `rows` rows.
    pub(super) fn convert(self, chunk: &mut Vec<u8>, width: usize, rows: usize, samples: usize) {
        match self {
            Colour::Keep => {}
            Colour::Jpeg => {
                for pixel in chunk.as_chunks_mut::<3>().0 {
                    *pixel = Yuv::JPEG.rgb(*pixel);
                }
            }
            Colour::Blocks(yuv, h, v) => {
                let mut rgb = vec![0; width * rows * 3];
                let across = width.div_ceil(h);
                for (i, block) in chunk.chunks_exact(h * v + 2).enumerate() {
                    let [cb, cr] = [block[h * v], block[h * v + 1]];
                    for (j, luma) in block[..h * v].iter().enumerate() {
                        let (x, y) = (i % across * h + j % h, i / across * v + j / h);
                        if x < width && y < rows {
                            let at = (y * width + x) * 3;
                            rgb[at..at + 3].copy_from_slice(&yuv.rgb([*luma, cb, cr]));
                        }
                    }
                }
                *chunk = rgb;
            }
            Colour::Cmyk => {
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

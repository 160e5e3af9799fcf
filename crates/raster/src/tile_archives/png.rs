//! Encoder of a whole PNG tile: indexed with the fewest bits that its colours need, grey or RGB,
//! with opacity only if needed.

use flate2::{Compress, Compression, Crc, FlushCompress};
use spinney_base::sort;

/// Pixels of a tile.
#[derive(Clone, Copy, Debug)]
pub(super) enum PngPixels<'a> {
    /// Colour indices, and the RGBA palette.
    Indexed(&'a [u8], &'a [[u8; 4]; 256]),
    /// RGBA of each pixel.
    Colours(&'a [[u8; 4]]),
}

/// Encoder whose buffers are reused between tiles.
pub(super) struct PngEncoder {
    compress: Compress,
    /// Whether RGB and grey pixels use the fast compressor.
    is_fast: bool,
    /// Filtered rows, each preceded by its filter type.
    rows: Vec<u8>,
    deflated: Vec<u8>,
}

/// Filter types and colour type bits (RFC 2083).
const NO_FILTER: u8 = 0;
const PAETH: u8 = 4;

const INDEXED: u8 = 3;
const ALPHA: u8 = 4;
const COLOUR: u8 = 2;

impl PngEncoder {
    /// An encoder with an effort from 1 (fast) to 9 (small). The default balances time and size:
    /// fdeflate for noisy rows of colours (a fifth of the time for a seventh more bytes), and level
    /// 4 for indexed tiles.
    pub(super) fn new(effort: Option<u8>) -> PngEncoder {
        PngEncoder {
            compress: Compress::new(Compression::new(effort.map_or(4, u32::from)), true),
            is_fast: effort.is_none(),
            rows: Vec::new(),
            deflated: Vec::new(),
        }
    }

    /// Encodes pixels, `width` per row, into `png`.
    pub(super) fn encode(&mut self, tile: PngPixels<'_>, width: usize, png: &mut Vec<u8>) {
        png.clear();
        png.extend(b"\x89PNG\r\n\x1a\n");
        match tile {
            PngPixels::Indexed(indices, colours) => self.indexed(indices, colours, width, png),
            PngPixels::Colours(pixels) => self.colours(pixels, width, png),
        }
        if self.is_fast && matches!(tile, PngPixels::Colours(_)) {
            chunk(png, *b"IDAT", &fdeflate::compress_to_vec(&self.rows));
            chunk(png, *b"IEND", &[]);
            return;
        }
        self.compress.reset();
        self.deflated.clear();
        // An upper bound for incompressible rows.
        self.deflated.reserve(self.rows.len() + self.rows.len() / 64 + 1024);
        let done = self.compress.compress_vec(&self.rows, &mut self.deflated, FlushCompress::Finish);
        debug_assert!(matches!(done, Ok(flate2::Status::StreamEnd)));
        chunk(png, *b"IDAT", &self.deflated);
        chunk(png, *b"IEND", &[]);
    }

    fn indexed(&mut self, indices: &[u8], colours: &[[u8; 4]; 256], width: usize, png: &mut Vec<u8>) {
        let mut used = [false; 256];
        indices.iter().for_each(|index| used[usize::from(*index)] = true);
        // The colours in use, those that are not opaque first: only these need an entry in tRNS.
        let mut numbers: Vec<usize> = (0..256).filter(|index| used[*index]).collect();
        sort::by_key(&mut numbers, |index| u64::from(colours[*index][3] == 255));
        let mut renumbered = [0; 256];
        numbers.iter().enumerate().for_each(|(new, old)| renumbered[*old] = new as u8);
        let bits = match numbers.len() {
            0..=2 => 1,
            3..=4 => 2,
            5..=16 => 4,
            _ => 8,
        };
        header(png, width, indices.len() / width, bits, INDEXED);
        let plte: Vec<u8> = numbers.iter().flat_map(|index| colours[*index][..3].to_vec()).collect();
        chunk(png, *b"PLTE", &plte);
        let opacities = numbers.iter().map(|index| colours[*index][3]);
        let trns: Vec<u8> = opacities.take_while(|opacity| *opacity < 255).collect();
        if !trns.is_empty() {
            chunk(png, *b"tRNS", &trns);
        }
        self.rows.clear();
        for row in indices.chunks_exact(width) {
            self.rows.push(NO_FILTER);
            match bits {
                1 => self.packed::<8>(row, &renumbered),
                2 => self.packed::<4>(row, &renumbered),
                4 => self.packed::<2>(row, &renumbered),
                _ => self.packed::<1>(row, &renumbered),
            }
        }
    }

    /// Packs a row with `PER` pixels per byte, the first in the highest bits.
    fn packed<const PER: usize>(&mut self, row: &[u8], renumbered: &[u8; 256]) {
        let pack = |group: &[u8; PER]| {
            let bits = group.iter().map(|index| u32::from(renumbered[usize::from(*index)]));
            bits.fold(0, |byte, number| byte << (8 / PER) | number) as u8
        };
        let (groups, rest) = row.as_chunks::<PER>();
        self.rows.extend(groups.iter().map(pack));
        if !rest.is_empty() {
            // Pixels after the end of the row are not visible.
            let mut last = [rest[0]; PER];
            last[..rest.len()].copy_from_slice(rest);
            self.rows.push(pack(&last));
        }
    }

    fn colours(&mut self, pixels: &[[u8; 4]], width: usize, png: &mut Vec<u8>) {
        let is_opaque = pixels.iter().all(|pixel| pixel[3] == 255);
        let is_grey = pixels.iter().all(|&[red, green, blue, _]| red == green && green == blue);
        let kind = if is_grey { 0 } else { COLOUR } | if is_opaque { 0 } else { ALPHA };
        header(png, width, pixels.len() / width, 8, kind);
        // Transparent pixels are set to 0, which compresses better.
        match (is_grey, is_opaque) {
            (true, true) => self.filtered(pixels, width, |pixel| [pixel[0]]),
            (true, false) => self.filtered(pixels, width, |pixel| [pixel[0], pixel[3]]),
            (false, true) => self.filtered(pixels, width, |[red, green, blue, _]| [red, green, blue]),
            (false, false) => self.filtered(pixels, width, |pixel| pixel),
        }
    }

    /// Filters rows of pixels of `N` samples with Paeth's filter, which does best on images, for
    /// single tiles and overall.
    fn filtered<const N: usize>(
        &mut self,
        pixels: &[[u8; 4]],
        width: usize,
        samples: impl Fn([u8; 4]) -> [u8; N],
    ) {
        // Each row is preceded by a pixel of zeros.
        let mut above = vec![[0; N]; width + 1];
        let mut here = above.clone();
        let stride = 1 + width * N;
        self.rows.resize(pixels.len() / width * stride, 0);
        for (row, bytes) in pixels.chunks_exact(width).zip(self.rows.chunks_exact_mut(stride)) {
            for (here, pixel) in here[1..].iter_mut().zip(row) {
                *here = if pixel[3] == 0 { [0; N] } else { samples(*pixel) };
            }
            bytes[0] = PAETH;
            let (left, corner) = (&here.as_flattened()[..width * N], &above.as_flattened()[..width * N]);
            let (own, upper) = (&here.as_flattened()[N..], &above.as_flattened()[N..]);
            for (at, filtered) in bytes[1..].iter_mut().enumerate() {
                *filtered = own[at].wrapping_sub(predicted(left[at], upper[at], corner[at]));
            }
            std::mem::swap(&mut above, &mut here);
        }
    }
}

/// Paeth's predictor (RFC 2083, 6.6).
#[inline]
fn predicted(left: u8, above: u8, corner: u8) -> u8 {
    let (a, b, c) = (i16::from(left), i16::from(above), i16::from(corner));
    let (to_left, to_above, to_corner) = ((b - c).abs(), (a - c).abs(), (a + b - 2 * c).abs());
    if to_left <= to_above && to_left <= to_corner {
        left
    } else if to_above <= to_corner {
        above
    } else {
        corner
    }
}

fn header(png: &mut Vec<u8>, width: usize, height: usize, bits: u8, kind: u8) {
    let mut bytes = Vec::with_capacity(13);
    bytes.extend((width as u32).to_be_bytes());
    bytes.extend((height as u32).to_be_bytes());
    bytes.extend([bits, kind, 0, 0, 0]);
    chunk(png, *b"IHDR", &bytes);
}

fn chunk(png: &mut Vec<u8>, name: [u8; 4], bytes: &[u8]) {
    png.extend((bytes.len() as u32).to_be_bytes());
    let mut checksum = Crc::new();
    checksum.update(&name);
    checksum.update(bytes);
    png.extend(name);
    png.extend_from_slice(bytes);
    png.extend(checksum.sum().to_be_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The image as decoded by another library: colours of all pixels, and the file's colour type.
    fn decoded(png: &[u8]) -> (Vec<[u8; 4]>, png::ColorType, png::BitDepth) {
        let mut decoder = png::Decoder::new(std::io::Cursor::new(png));
        let kind =
            decoder.read_header_info().map(|info| (info.color_type, info.bit_depth)).expect("a header");
        decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::ALPHA);
        let mut reader = decoder.read_info().expect("a PNG image");
        let mut bytes = vec![0; reader.output_buffer_size().expect("a small one")];
        let info = reader.next_frame(&mut bytes).expect("good rows");
        let pixels = bytes.chunks_exact(info.color_type.samples()).map(|pixel| match *pixel {
            [grey, alpha] => [grey, grey, grey, alpha],
            [red, green, blue, alpha] => [red, green, blue, alpha],
            _ => panic!("no opacity"),
        });
        (pixels.collect(), kind.0, kind.1)
    }

    #[test]
    fn palettes_take_as_few_bits_as_their_colours_need() {
        let mut colours = std::array::from_fn(|index| [index as u8, 7, 9, 255]);
        colours[200][3] = 0;
        let mut encoder = PngEncoder::new(None);
        for (count, bits) in [(1, 1), (2, 1), (3, 2), (5, 4), (16, 4), (17, 8), (56, 8)] {
            // The width does not fill whole bytes.
            let indices: Vec<u8> = (0..37 * 5).map(|at| 200 + (at * at % count) as u8).collect();
            let mut png = Vec::new();
            encoder.encode(PngPixels::Indexed(&indices, &colours), 37, &mut png);
            let (pixels, kind, depth) = decoded(&png);
            let expected: Vec<_> = indices.iter().map(|index| colours[usize::from(*index)]).collect();
            assert_eq!(pixels, expected, "{count} colours");
            assert_eq!(kind, png::ColorType::Indexed);
            assert!(depth as u8 <= bits, "{count} colours with {depth:?}");
        }
    }

    #[test]
    fn colours_take_the_channels_they_need() {
        let mut encoder = PngEncoder::new(None);
        let noise = |at: usize| ((at * at * 31) >> 3) as u8;
        let grey: Vec<_> = (0..64 * 9).map(|at| [noise(at), noise(at), noise(at), 255]).collect();
        let rgb: Vec<_> = (0..64 * 9).map(|at| [noise(at), noise(at + 7), at as u8, 255]).collect();
        let half = |pixels: &[[u8; 4]]| -> Vec<[u8; 4]> {
            // Fully transparent pixels lose their colour.
            let part = pixels.iter().enumerate();
            part.map(|(at, pixel)| if at % 3 == 0 { [0; 4] } else { [pixel[0], pixel[1], pixel[2], 128] })
                .collect()
        };
        let cases = [
            (grey.clone(), png::ColorType::Grayscale),
            (half(&grey), png::ColorType::GrayscaleAlpha),
            (rgb.clone(), png::ColorType::Rgb),
            (half(&rgb), png::ColorType::Rgba),
        ];
        for (pixels, kind) in cases {
            let mut png = Vec::new();
            encoder.encode(PngPixels::Colours(&pixels), 64, &mut png);
            let (found, found_kind, _) = decoded(&png);
            assert!(found == pixels, "{kind:?}");
            assert_eq!(found_kind, kind);
        }
    }
}

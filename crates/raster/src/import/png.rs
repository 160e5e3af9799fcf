//! Reader of PNG, row by row.

use std::collections::BTreeMap;
use std::io::{BufReader, ErrorKind};
use std::path::{Path, PathBuf};

use png::{BitDepth, ColorType, Decoder, DecodingError, Info, Limits, Reader};

use super::{Order, Pixels, Raster, RasterInfo, RasterOptions};
use spinney_base::guard::guard;
use spinney_base::io::InputFile;
use spinney_base::space::Region;
use spinney_base::value::{DataKind, Palette, SampleType};
use spinney_base::{Error, Result};

struct Png {
    path: PathBuf,
    info: RasterInfo,
    reader: Reader<BufReader<InputFile>>,
    /// Bits of a sample in the file.
    depth: u8,
    /// One row as stored in the file, or all rows if they are interlaced: packed and big-endian.
    raw: Vec<u8>,
    next_row: u64,
    void: Void,
}

/// Pixels that the tRNS chunk makes VOID.
enum Void {
    None,
    /// Pixels with these palette indices.
    Indexes(Box<[bool; 256]>),
    /// Pixels of this colour, as bytes of a pixel.
    Colour(Vec<u8>),
}

pub(super) fn open(path: &Path, options: &RasterOptions) -> Result<Box<dyn Raster>> {
    let file = options.access.input(path)?;
    let (reader, row_bytes) = guard(path, "PNG header", || {
        let limits = Limits { bytes: usize::try_from(options.memory).unwrap_or(usize::MAX) };
        let mut decoder = Decoder::new_with_limits(BufReader::with_capacity(1 << 16, file), limits);
        decoder.set_ignore_iccp_chunk(true);
        let header = decoder.read_header_info().map_err(|error| png_error(path, error))?;
        let bits = u64::from(header.width) * header.bits_per_pixel() as u64;
        let row_bytes = bits.div_ceil(8);
        // Both the decoder and this reader hold a few rows.
        options.check_memory(path, "a few rows of the image", row_bytes.saturating_mul(4))?;
        if header.interlaced {
            let all = row_bytes.saturating_mul(header.height.into());
            options.check_memory(path, "an interlaced image", all)?;
        }
        Ok((decoder.read_info().map_err(|error| png_error(path, error))?, row_bytes as usize))
    })?;

    let header = reader.info();
    if header.frame_control.is_some_and(|frame| (frame.width, frame.height) != header.size()) {
        return Err(corrupt(path, "a first animation frame that is smaller than the image"));
    }
    let depth = header.bit_depth as u8;
    let info = describe(header);
    let void = void_rule(path, header, info.palette.as_ref())?;
    let raw = vec![0; row_bytes * if header.interlaced { header.height as usize } else { 1 }];
    Ok(Box::new(Png { path: path.to_path_buf(), info, reader, depth, raw, next_row: 0, void }))
}

fn describe(header: &Info) -> RasterInfo {
    let sample = if header.bit_depth == BitDepth::Sixteen { SampleType::U16 } else { SampleType::U8 };
    let channels = header.color_type.samples();
    let size = [header.width.into(), header.height.into()];
    let palette = (header.color_type == ColorType::Indexed).then(|| palette(header));
    let (tags, left_out) = strings(header);
    let without = match left_out {
        0 => String::new(),
        count => format!(", without strings that are corrupt or longer than {} MiB: {count}", MAX_TEXT >> 20),
    };
    let rows = if header.interlaced { "interlaced" } else { "rows" };
    RasterInfo {
        stored_sample: match header.bit_depth as u8 {
            bits @ (8 | 16) => format!("u{bits}"),
            bits => format!("uint{bits}"),
        },
        alpha: match header.color_type {
            ColorType::GrayscaleAlpha => Some(1),
            ColorType::Rgba => Some(3),
            _ => None,
        },
        kind: palette.is_some().then_some(DataKind::Categorical),
        palette,
        layout: format!("PNG, {rows}{without}"),
        tags,
        order: Order::Bands,
        ..RasterInfo::plain(size, sample, channels)
    }
    .in_colour()
}

/// Maximum size of all text chunks in bytes: half of the limit of a tree's metadata.
const MAX_TEXT: usize = 8 << 20;

/// A text decoded from its chunk.
type TextResult = std::result::Result<String, DecodingError>;

/// Decodes text chunks by their keywords, and counts those that cannot be decompressed or are too
/// long: a few bytes may expand to gigabytes.
fn strings(header: &Info) -> (BTreeMap<String, String>, usize) {
    let (mut strings, mut left_out, mut budget) = (BTreeMap::new(), 0, MAX_TEXT);
    let mut add = |name: &str, unpack: &dyn Fn(usize) -> TextResult| match unpack(budget) {
        Ok(text) if text.len() <= budget => {
            budget -= text.len();
            strings.insert(name.to_string(), text);
        }
        _ => left_out += 1,
    };
    for chunk in &header.uncompressed_latin1_text {
        add(&chunk.keyword, &|_| Ok(chunk.text.clone()));
    }
    for chunk in &header.compressed_latin1_text {
        add(&chunk.keyword, &|budget| {
            let mut chunk = chunk.clone();
            chunk.decompress_text_with_limit(budget)?;
            chunk.get_text()
        });
    }
    for chunk in &header.utf8_text {
        add(&chunk.keyword, &|budget| {
            let mut chunk = chunk.clone();
            chunk.decompress_text_with_limit(budget)?;
            chunk.get_text()
        });
    }
    (strings, left_out)
}

fn palette(header: &Info) -> Palette {
    let colours = header.palette.as_deref().unwrap_or_default().as_chunks::<3>().0;
    let alphas = header.trns.as_deref().unwrap_or_default().iter().copied().chain(std::iter::repeat(255));
    Palette { colours: colours.iter().zip(alphas).map(|(&[r, g, b], a)| [r, g, b, a]).collect() }
}

fn void_rule(path: &Path, header: &Info, palette: Option<&Palette>) -> Result<Void> {
    let Some(transparent) = header.trns.as_deref() else { return Ok(Void::None) };
    if let Some(palette) = palette {
        let is_void = |index| palette.colours.get(index).is_some_and(|colour: &[u8; 4]| colour[3] == 0);
        return Ok(Void::Indexes(Box::new(std::array::from_fn(is_void))));
    }
    let pixel_bytes = header.color_type.samples() * if header.bit_depth == BitDepth::Sixteen { 2 } else { 1 };
    let mut colour =
        transparent.get(..pixel_bytes).ok_or_else(|| corrupt(path, "a short tRNS chunk"))?.to_vec();
    if header.bit_depth == BitDepth::Sixteen {
        colour.as_chunks_mut::<2>().0.iter_mut().for_each(|sample| sample.reverse());
    }
    Ok(Void::Colour(colour))
}

impl Png {
    /// Decodes the next row into `raw`, or all rows at the start of an interlaced image.
    fn decode_next(&mut self) -> Result<()> {
        let Png { reader, raw, next_row, path, info, .. } = self;
        guard(path, &format!("PNG row {next_row}"), || {
            if !reader.info().interlaced {
                let row = reader.read_row(raw).map_err(|error| png_error(path, error))?;
                row.ok_or_else(|| corrupt(path, "too few rows"))?;
            } else if *next_row == 0 {
                reader.next_frame(raw).map_err(|error| png_error(path, error))?;
            }
            if *next_row + 1 == info.height {
                // Read to the end of the file, to detect truncated or modified files.
                reader.finish().map_err(|error| png_error(path, error))?;
            }
            Ok(())
        })
    }
}

impl Raster for Png {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.info.check(region)?;
        if region.x != 0 || region.width != self.info.width || region.y != self.next_row {
            let expected = format!("full-width rows from row {}", self.next_row);
            return Err(Error::invalid("region of a PNG image", format!("{region:?}"), expected));
        }
        let samples = self.info.width as usize * self.info.channels;
        let row_bytes = (samples * usize::from(self.depth)).div_ceil(8);
        pixels.bytes.clear();
        for _ in 0..region.height {
            self.decode_next()?;
            let first = if self.raw.len() > row_bytes { self.next_row as usize * row_bytes } else { 0 };
            unpack(&self.raw[first..][..row_bytes], self.depth, samples, &mut pixels.bytes);
            self.next_row += 1;
        }
        pixels.valid = match &self.void {
            Void::None => None,
            Void::Indexes(void) => Some(pixels.bytes.iter().map(|&i| !void[usize::from(i)]).collect()),
            Void::Colour(colour) => {
                Some(pixels.bytes.chunks_exact(colour.len()).map(|pixel| pixel != colour).collect())
            }
        };
        Ok(())
    }
}

/// Appends a row's samples as bytes, or as little-endian pairs of bytes.
fn unpack(raw: &[u8], depth: u8, samples: usize, out: &mut Vec<u8>) {
    match depth {
        8 => out.extend_from_slice(raw),
        16 => out.extend(raw.as_chunks::<2>().0.iter().flat_map(|&[high, low]| [low, high])),
        _ => {
            // 1, 2 or 4 bits, the first sample in the highest.
            let per_byte = 8 / depth;
            let mask = (1u8 << depth) - 1;
            let spread = |byte: &u8| {
                let byte = *byte;
                (1..=per_byte).map(move |i| byte >> (8 - i * depth) & mask)
            };
            out.extend(raw.iter().flat_map(spread).take(samples));
        }
    }
}

fn corrupt(path: &Path, found: impl Into<String>) -> Error {
    Error::corrupt(path, "PNG data", found, "a valid PNG image")
}

fn png_error(path: &Path, error: DecodingError) -> Error {
    match error {
        DecodingError::IoError(error) if error.kind() == ErrorKind::UnexpectedEof => {
            corrupt(path, "the end of the file")
        }
        DecodingError::IoError(error) => Error::io(path, "read")(error),
        DecodingError::LimitsExceeded => {
            Error::unsupported(path, "a chunk larger than the memory limit", "allow more with --memory")
        }
        other => corrupt(path, other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::unpack;

    #[test]
    fn packed_samples_are_unpacked() {
        let cases: [(&[u8], u8, usize, &[u8]); 4] = [
            (&[0b1010_0000], 1, 3, &[1, 0, 1]),
            (&[0b1101_1000], 2, 3, &[3, 1, 2]),
            (&[0xf1, 0x20], 4, 3, &[15, 1, 2]),
            (&[1, 2, 3, 4], 16, 2, &[2, 1, 4, 3]),
        ];
        for (raw, depth, samples, expected) in cases {
            let mut out = Vec::new();
            unpack(raw, depth, samples, &mut out);
            assert_eq!(out, expected);
        }
    }
}

//! A writer of TIFF files of many layouts, with random pixels.

use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

use crate::common::Random;

/// Shape of chunks.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Chunks {
    /// Tiles of columns and rows.
    Tiles(u64, u64),
    /// Strips of rows.
    Strips(u64),
}

/// Compression of chunks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Packing {
    None,
    Deflate,
    Lzw,
    Zstd,
    PackBits,
}

/// Type of samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Samples {
    Uint(u16),
    Int(u16),
    Float(u16),
}

impl Samples {
    fn bits(self) -> u16 {
        match self {
            Samples::Uint(bits) | Samples::Int(bits) | Samples::Float(bits) => bits,
        }
    }

    /// Returns the bits of a sample that has a number.
    pub(crate) fn of(self, number: i64) -> u64 {
        match self {
            Samples::Uint(_) => number.unsigned_abs(),
            Samples::Int(bits) => number as u64 & (u64::MAX >> (64 - bits)),
            Samples::Float(64) => (number as f64 * 0.5).to_bits(),
            Samples::Float(32) => (number as f32 * 0.5).to_bits().into(),
            // (Normal numbers and zero alone.)
            Samples::Float(_) => match (number as f32 * 0.5).to_bits() {
                0 => 0,
                bits => u64::from((bits >> 13) - (112 << 10)),
            },
        }
    }

    /// Returns the bits of NaN.
    pub(crate) fn nan(self) -> u64 {
        match self {
            Samples::Float(64) => f64::NAN.to_bits(),
            Samples::Float(32) => f32::NAN.to_bits().into(),
            _ => 0x7e00,
        }
    }
}

/// A file of one image. Its pixels can be changed.
#[derive(Clone, Debug)]
pub(crate) struct Tiff {
    pub(crate) size: [u64; 2],
    pub(crate) chunks: Chunks,
    pub(crate) packing: Packing,
    /// 1 none, 2 differences, 3 floating point.
    pub(crate) predictor: u16,
    pub(crate) samples: Samples,
    pub(crate) channels: usize,
    pub(crate) is_planar: bool,
    pub(crate) is_big_endian: bool,
    /// Whether the last channel is opacity.
    pub(crate) has_alpha: bool,
    /// Whether there are colours of classes.
    pub(crate) has_palette: bool,
    pub(crate) nodata: Option<&'static str>,
    /// Flags of pixels that are not VOID.
    pub(crate) mask: Option<Vec<bool>>,
    /// Whether chunks of zeros are not written.
    pub(crate) is_sparse: bool,
    /// Column and row of the first pixel on the grid of all files.
    pub(crate) origin: Option<[i64; 2]>,
    /// Bits of all samples, pixel by pixel.
    pub(crate) pixels: Vec<u64>,
}

impl Tiff {
    /// Returns a grey image of bytes in tiles, with patches of few numbers and some noise.
    pub(crate) fn new(size: [u64; 2], seed: u64) -> Tiff {
        Tiff {
            size,
            chunks: Chunks::Tiles(48, 48),
            packing: Packing::Deflate,
            predictor: 1,
            samples: Samples::Uint(8),
            channels: 1,
            is_planar: false,
            is_big_endian: false,
            has_alpha: false,
            has_palette: false,
            nodata: None,
            mask: None,
            is_sparse: false,
            origin: None,
            pixels: Vec::new(),
        }
        .filled(seed)
    }

    /// Fills the image with random numbers from 0 to 8. Large patches are zero.
    pub(crate) fn filled(mut self, seed: u64) -> Tiff {
        let mut random = Random(seed);
        let [width, height] = self.size;
        self.pixels.clear();
        for y in 0..height {
            for x in 0..width {
                let patch = Random(seed ^ (x / 41) ^ (y / 53) << 20).next();
                for channel in 0..self.channels as u64 {
                    let noise = if patch.is_multiple_of(3) { random.below(9) } else { 0 };
                    let number = match patch % 4 {
                        0 => 0,
                        _ => (patch >> 8) % 5 + channel + noise,
                    };
                    self.pixels.push(self.samples.of(number as i64 % 9));
                }
            }
        }
        self
    }

    /// Sets all samples of a pixel.
    pub(crate) fn set(&mut self, [x, y]: [u64; 2], bits: u64) {
        let at = (y * self.size[0] + x) as usize * self.channels;
        self.pixels[at..at + self.channels].fill(bits);
    }

    /// Sets the samples of a box to a number.
    pub(crate) fn fill(&mut self, [x, y]: [u64; 2], [width, height]: [u64; 2], number: i64) {
        let bits = self.samples.of(number);
        for row in y..(y + height).min(self.size[1]) {
            (x..(x + width).min(self.size[0])).for_each(|column| self.set([column, row], bits));
        }
    }

    pub(crate) fn write(&self, path: &Path) {
        std::fs::write(path, self.bytes()).unwrap();
    }

    /// Columns and rows of a chunk.
    pub(crate) fn chunk_size(&self) -> [u64; 2] {
        match self.chunks {
            Chunks::Tiles(width, height) => [width, height],
            Chunks::Strips(rows) => [self.size[0], rows.min(self.size[1])],
        }
    }

    /// Returns the stored bytes of each chunk; none for those that are not written.
    fn chunks(&self) -> Vec<Vec<u8>> {
        let [width, height] = self.chunk_size();
        let planes = if self.is_planar { self.channels } else { 1 };
        let mut all = Vec::new();
        for plane in 0..planes {
            let channels = if self.is_planar { plane..plane + 1 } else { 0..self.channels };
            for top in (0..self.size[1]).step_by(height as usize) {
                let is_strip = matches!(self.chunks, Chunks::Strips(_));
                let rows = if is_strip { height.min(self.size[1] - top) } else { height };
                for left in (0..self.size[0]).step_by(width as usize) {
                    let mut bytes = Vec::new();
                    let mut is_zero = true;
                    for y in top..top + rows {
                        let pixels = (left..left + width).map(|x| {
                            let is_inside = x < self.size[0] && y < self.size[1];
                            is_inside.then(|| (y * self.size[0] + x) as usize * self.channels)
                        });
                        let row: Vec<u64> = pixels
                            .flat_map(|at| {
                                channels
                                    .clone()
                                    .map(move |channel| at.map_or(0, |at| self.pixels[at + channel]))
                            })
                            .collect();
                        is_zero &= row.iter().all(|bits| *bits == 0);
                        bytes.extend(self.row(&row, channels.len()));
                    }
                    let is_written = !(self.is_sparse && is_zero);
                    all.push(if is_written { self.packing.pack(&bytes) } else { Vec::new() });
                }
            }
        }
        all
    }

    /// Returns the bytes of a row of samples, `pixel` of which are a pixel.
    fn row(&self, row: &[u64], pixel: usize) -> Vec<u8> {
        let bits = usize::from(self.samples.bits());
        if !bits.is_multiple_of(8) {
            let mut out = BitWriter::default();
            row.iter().for_each(|sample| out.put(*sample, bits));
            return out.bytes;
        }
        let size = bits / 8;
        let big = |sample: &u64| sample.to_be_bytes()[8 - size..].to_vec();
        if self.predictor == 3 {
            let samples: Vec<Vec<u8>> = row.iter().map(big).collect();
            let planes: Vec<u8> =
                (0..size).flat_map(|byte| samples.iter().map(move |sample| sample[byte])).collect();
            let before = |at: usize| at.checked_sub(pixel).map_or(0, |at| planes[at]);
            return (0..planes.len()).map(|at| planes[at].wrapping_sub(before(at))).collect();
        }
        let before = |at: usize| match at.checked_sub(pixel) {
            Some(at) if self.predictor == 2 => row[at],
            _ => 0,
        };
        let stored = (0..row.len()).map(|at| row[at].wrapping_sub(before(at)));
        let mut bytes = Vec::new();
        for sample in stored {
            match self.is_big_endian {
                true => bytes.extend(big(&sample)),
                false => bytes.extend(&sample.to_le_bytes()[..size]),
            }
        }
        bytes
    }

    /// Returns the bytes of the file.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        pages(std::slice::from_ref(self))
    }

    fn append(&self, file: &mut FileWriter) {
        let is_tiled = matches!(self.chunks, Chunks::Tiles(..));
        let format = match self.samples {
            Samples::Uint(_) => 1,
            Samples::Int(_) => 2,
            Samples::Float(_) => 3,
        };
        let each = |value: u64| vec![value; self.channels];
        let colours = if self.channels >= 3 { 3 } else { 1 };
        let photometric = if self.has_palette { 3 } else { u64::from(self.channels >= 3) + 1 };
        let mut tags = vec![
            (258, 3, each(self.samples.bits().into())),
            (259, 3, vec![self.packing.number()]),
            (262, 3, vec![photometric]),
            (277, 3, vec![self.channels as u64]),
            (284, 3, vec![1 + u64::from(self.is_planar)]),
            (317, 3, vec![self.predictor.into()]),
            (339, 3, each(format)),
        ];
        if self.channels > colours {
            let mut extra = vec![0; self.channels - colours];
            *extra.last_mut().unwrap() = if self.has_alpha { 2 } else { 0 };
            tags.push((338, 3, extra));
        }
        if self.has_palette {
            tags.push((320, 3, (0..768).map(|entry| entry * 85 % 65536).collect()));
        }
        if let Some(nodata) = self.nodata {
            tags.push((42113, 2, nodata.bytes().chain([0]).map(u64::from).collect()));
        }
        if let Some([x, y]) = self.origin {
            let number = |number: f64| number.to_bits();
            tags.push((33550, 12, [1.0, 1.0, 0.0].map(number).into()));
            tags.push((
                33922,
                12,
                [0.0, 0.0, 0.0, 500.0 + x as f64, 900.0 - y as f64, 0.0].map(number).into(),
            ));
            tags.push((34735, 3, vec![1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 32632]));
        }
        file.image((self.size, self.chunk_size(), is_tiled), tags, &self.chunks());
        if let Some(mask) = &self.mask {
            // (One strip of bits, deflated.)
            let mut bits = BitWriter::default();
            for row in mask.chunks_exact(self.size[0] as usize) {
                row.iter().for_each(|flag| bits.put((*flag).into(), 1));
                bits.align();
            }
            let tags = [(254, 4), (258, 1), (259, 8), (262, 4), (277, 1)];
            let tags = tags.map(|(tag, value)| (tag, 3, vec![value])).into();
            file.image((self.size, self.size, false), tags, &[Packing::Deflate.pack(&bits.bytes)]);
        }
    }
}

/// Returns the bytes of a file whose pages are images.
pub(crate) fn pages(images: &[Tiff]) -> Vec<u8> {
    let mut file = FileWriter::new(images[0].is_big_endian);
    images.iter().for_each(|image| image.append(&mut file));
    file.bytes
}

/// A file that is written image by image.
struct FileWriter {
    bytes: Vec<u8>,
    is_big_endian: bool,
    /// Where the offset of the next image is written.
    link: usize,
}

/// A tag, the type of its values, and these (numbers of doubles as bits).
type Tag = (u16, u16, Vec<u64>);

impl FileWriter {
    fn new(is_big_endian: bool) -> FileWriter {
        let bytes = if is_big_endian { b"MM\0*\0\0\0\0" } else { b"II*\0\0\0\0\0" };
        FileWriter { bytes: bytes.to_vec(), is_big_endian, link: 4 }
    }

    fn number(&self, number: u64, size: usize) -> Vec<u8> {
        match self.is_big_endian {
            true => number.to_be_bytes()[8 - size..].to_vec(),
            false => number.to_le_bytes()[..size].to_vec(),
        }
    }

    /// Writes an image: its size, the size of its chunks, whether these are tiles, tags, chunks.
    fn image(&mut self, layout: ([u64; 2], [u64; 2], bool), mut tags: Vec<Tag>, chunks: &[Vec<u8>]) {
        let (size, chunk, is_tiled) = layout;
        let mut offsets = Vec::new();
        for stored in chunks {
            offsets.push(if stored.is_empty() { 0 } else { self.bytes.len() as u64 });
            self.bytes.extend(stored);
        }
        let lengths = chunks.iter().map(|stored| stored.len() as u64).collect();
        tags.extend([(256, 4, vec![size[0]]), (257, 4, vec![size[1]])]);
        match is_tiled {
            true => tags.extend([
                (322, 4, vec![chunk[0]]),
                (323, 4, vec![chunk[1]]),
                (324, 4, offsets),
                (325, 4, lengths),
            ]),
            false => tags.extend([(273, 4, offsets), (278, 4, vec![chunk[1]]), (279, 4, lengths)]),
        }
        tags.sort_by_key(|(tag, ..)| *tag);
        let mut entries = Vec::new();
        for (tag, kind, values) in &tags {
            let width = match kind {
                2 => 1,
                3 => 2,
                4 => 4,
                _ => 8,
            };
            let mut data: Vec<u8> = values.iter().flat_map(|value| self.number(*value, width)).collect();
            entries.extend(self.number((*tag).into(), 2));
            entries.extend(self.number((*kind).into(), 2));
            entries.extend(self.number(values.len() as u64, 4));
            if data.len() > 4 {
                entries.extend(self.number(self.bytes.len() as u64, 4));
                self.bytes.extend(data);
            } else {
                data.resize(4, 0);
                entries.extend(data);
            }
        }
        let here = self.number(self.bytes.len() as u64, 4);
        self.bytes[self.link..self.link + 4].copy_from_slice(&here);
        self.bytes.extend(self.number(tags.len() as u64, 2));
        self.bytes.extend(entries);
        self.link = self.bytes.len();
        self.bytes.extend([0; 4]);
    }
}

/// Bits, from the highest of each byte down.
#[derive(Default)]
struct BitWriter {
    bytes: Vec<u8>,
    used: usize,
}

impl BitWriter {
    fn put(&mut self, number: u64, bits: usize) {
        for bit in (0..bits).rev() {
            if self.used.is_multiple_of(8) {
                self.bytes.push(0);
            }
            *self.bytes.last_mut().unwrap() |= ((number >> bit & 1) as u8) << (7 - self.used % 8);
            self.used += 1;
        }
    }

    fn align(&mut self) {
        self.used = self.used.next_multiple_of(8);
    }
}

impl Packing {
    /// Value of the tag Compression.
    fn number(self) -> u64 {
        match self {
            Packing::None => 1,
            Packing::Lzw => 5,
            Packing::Deflate => 8,
            Packing::PackBits => 32773,
            Packing::Zstd => 50000,
        }
    }

    pub(crate) fn pack(self, bytes: &[u8]) -> Vec<u8> {
        match self {
            Packing::None => bytes.to_vec(),
            Packing::Deflate => {
                let mut writer = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
                writer.write_all(bytes).unwrap();
                writer.finish().unwrap()
            }
            Packing::Zstd => zstd::encode_all(bytes, 1).unwrap(),
            Packing::Lzw => lzw(bytes),
            Packing::PackBits => pack_bits(bytes),
        }
    }
}

/// Runs of equal bytes, and of others.
fn pack_bits(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut rest = bytes;
    while let Some(first) = rest.first() {
        let run = rest.iter().take(128).take_while(|byte| *byte == first).count();
        let count = if run > 2 { run } else { rest.len().min(5) };
        if run > 2 {
            out.extend([(257 - run) as u8, *first]);
        } else {
            out.push(count as u8 - 1);
            out.extend(&rest[..count]);
        }
        rest = &rest[count..];
    }
    out
}

/// TIFF's variant of LZW.
fn lzw(bytes: &[u8]) -> Vec<u8> {
    let mut out = BitWriter::default();
    let (mut known, mut next, mut width) = (HashMap::new(), 258, 9);
    let mut prefix: Option<u16> = None;
    out.put(256, width);
    for byte in bytes {
        let Some(code) = prefix else {
            prefix = Some((*byte).into());
            continue;
        };
        if let Some(longer) = known.get(&(code, *byte)) {
            prefix = Some(*longer);
            continue;
        }
        out.put(code.into(), width);
        known.insert((code, *byte), next);
        next += 1;
        if next == 4094 {
            out.put(256, width);
            (known, next, width) = (HashMap::new(), 258, 9);
        } else if next >= 1 << width {
            width += 1;
        }
        prefix = Some((*byte).into());
    }
    if let Some(code) = prefix {
        out.put(code.into(), width);
        next += 1;
        width += usize::from(next >= 1 << width);
    }
    out.put(257, width);
    out.bytes
}

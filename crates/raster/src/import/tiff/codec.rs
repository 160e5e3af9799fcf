//! Decompression of single chunks.
//!
//! Chunks compressed with deflate, zstd or LZW, the usual ones, are decoded directly into their
//! buffer, with decoder states that are reused for all chunks. The other codecs are those of the
//! `tiff` crate. It gets an in-memory file whose only strip is the chunk, with bytes as samples, so
//! that it decompresses and does nothing else.

use std::io::Cursor;

use tiff::decoder::{Decoder, Limits};

use super::spec::field_type::{ASCII, LONG, SHORT, UNDEFINED};
use super::spec::{compression as scheme, photometric, tag};

/// Compression of chunks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Deflate,
    Zstd,
    Lzw,
    PackBits,
    Fax4,
    WebP,
    /// With tables that are shared by all chunks; may be empty.
    Jpeg(Vec<u8>),
}

/// Shape of a decoded chunk.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChunkShape {
    /// Pixels per row.
    pub(super) width: usize,
    pub(super) rows: usize,
    /// Maximum number of rows in the compressed data: the last strip may be as high as the others.
    pub(super) max_rows: usize,
    /// Samples per pixel in this chunk.
    pub(super) samples: usize,
    /// Bytes per row.
    pub(super) row_bytes: usize,
}

/// Decoder states that are expensive to create; used by one thread at a time.
#[derive(Default)]
pub(super) struct States {
    inflate: Option<flate2::Decompress>,
    zstd: Option<zstd::bulk::Decompressor<'static>>,
    lzw: Option<weezl::decode::Decoder>,
}

impl Compression {
    /// The codec for the tag Compression. The error names an unsupported codec.
    pub(super) fn new(compression: u64, jpeg_tables: Option<Vec<u8>>) -> Result<Compression, String> {
        Ok(match compression {
            scheme::NONE => Compression::None,
            scheme::LZW => Compression::Lzw,
            scheme::JPEG => Compression::Jpeg(jpeg_tables.unwrap_or_default()),
            scheme::ADOBE_DEFLATE | scheme::DEFLATE => Compression::Deflate,
            scheme::CCITT_GROUP_4 => Compression::Fax4,
            scheme::PACK_BITS => Compression::PackBits,
            scheme::ZSTD => Compression::Zstd,
            scheme::WEBP => Compression::WebP,
            other => {
                let name = match other {
                    2 => "CCITT RLE",
                    3 => "CCITT group 3 fax",
                    6 => "old-style JPEG",
                    32766 => "NeXT",
                    32809 => "ThunderScan",
                    34676 | 34677 => "SGI LogLuv",
                    34712 => "JPEG 2000",
                    34887 => "LERC",
                    34925 => "LZMA",
                    50002 => "JPEG XL",
                    _ => "unknown",
                };
                return Err(format!("compression {other} ({name})"));
            }
        })
    }

    /// Name of the codec.
    pub(super) fn name(&self) -> &'static str {
        match self {
            Compression::None => "uncompressed",
            Compression::Deflate => "deflate",
            Compression::Zstd => "zstd",
            Compression::Lzw => "lzw",
            Compression::PackBits => "packbits",
            Compression::Fax4 => "group 4 fax",
            Compression::WebP => "webp",
            Compression::Jpeg(_) => "jpeg",
        }
    }

    /// Whether the predictor tag applies; other codecs ignore it.
    pub(super) fn has_predictor(&self) -> bool {
        matches!(self, Compression::Deflate | Compression::Zstd | Compression::Lzw)
    }

    /// Whether the codec has a bit order of its own, so that FillOrder does not apply.
    pub(super) fn ignores_fill_order(&self) -> bool {
        matches!(self, Compression::Jpeg(_) | Compression::WebP)
    }

    /// Decodes a chunk to fill `out`. The error describes what is wrong with it.
    pub(super) fn decode(
        &self,
        states: &mut States,
        raw: &[u8],
        shape: ChunkShape,
        out: &mut [u8],
    ) -> Result<(), String> {
        match self {
            Compression::None => {
                let samples = raw.get(..out.len()).ok_or_else(|| format!("only {} bytes", raw.len()))?;
                out.copy_from_slice(samples);
                Ok(())
            }
            Compression::Deflate => inflate(states, raw, out),
            Compression::Zstd => unzstd(states, raw, out),
            Compression::Lzw => unlzw(states, raw, out),
            Compression::PackBits | Compression::Fax4 => self.by_crate(raw, shape, out),
            Compression::WebP => {
                let (width, rows) = webp_size(raw).ok_or("no WebP header")?;
                same_size(shape, width, rows)?;
                self.by_crate(raw, ChunkShape { rows, ..shape }, out)
            }
            Compression::Jpeg(tables) => {
                let frame = JpegFrame::find(raw).ok_or("no JPEG frame header")?;
                if frame.bits != 8 {
                    return Err(format!(
                        "JPEG samples of {} bits, of which only 8 are supported",
                        frame.bits
                    ));
                }
                if frame.components != shape.samples {
                    return Err(format!("a JPEG image of {} components", frame.components));
                }
                same_size(shape, frame.width, frame.rows)?;
                if !tables.is_empty() && (tables.len() < 4 || raw.len() < 2) {
                    return Err("too short JPEG tables".into());
                }
                self.by_crate(raw, ChunkShape { rows: frame.rows, ..shape }, out)
            }
        }
    }

    /// Decodes with the `tiff` crate.
    fn by_crate(&self, raw: &[u8], shape: ChunkShape, out: &mut [u8]) -> Result<(), String> {
        let ChunkShape { width, rows, samples, row_bytes, .. } = shape;
        let (compression, width, bits, samples) = match self {
            Compression::Fax4 => (scheme::CCITT_GROUP_4, width, 1, 1),
            Compression::Jpeg(_) => (scheme::JPEG, width, 8, samples),
            Compression::WebP => (scheme::WEBP, width, 8, samples),
            _ => (scheme::PACK_BITS, row_bytes, 8, 1),
        };
        let file = one_strip(raw, [width, rows, bits, compression as usize, samples], self.tables());
        let mut limits = Limits::unlimited();
        limits.ifd_value_size = file.len();
        let decode = || {
            let mut decoder = Decoder::new(Cursor::new(file))?.with_limits(limits);
            if row_bytes * rows == out.len() {
                return decoder.read_chunk_bytes(0, out);
            }
            // The stream has more rows than needed, and the crate decodes all rows or none.
            let mut all = vec![0; row_bytes * rows];
            decoder.read_chunk_bytes(0, &mut all)?;
            out.copy_from_slice(&all[..out.len()]);
            Ok(())
        };
        decode().map_err(|error| format!("bad {} data ({error})", self.name()))
    }

    fn tables(&self) -> &[u8] {
        if let Compression::Jpeg(tables) = self { tables } else { &[] }
    }
}

fn inflate(states: &mut States, raw: &[u8], out: &mut [u8]) -> Result<(), String> {
    let state = states.inflate.get_or_insert_with(|| flate2::Decompress::new(true));
    state.reset(true);
    let result = state.decompress(raw, out, flate2::FlushDecompress::Finish);
    match (state.total_out() == out.len() as u64, result) {
        (true, Ok(_)) => Ok(()),
        (_, Err(error)) => Err(format!("bad deflate data ({error})")),
        (false, Ok(_)) => Err(format!("deflate data that end after {} bytes", state.total_out())),
    }
}

fn unzstd(states: &mut States, raw: &[u8], out: &mut [u8]) -> Result<(), String> {
    let wrong = |error| format!("bad zstd data ({error})");
    if states.zstd.is_none() {
        states.zstd = Some(zstd::bulk::Decompressor::new().map_err(wrong)?);
    }
    let state = states.zstd.as_mut().expect("created above");
    match state.decompress_to_buffer(raw, out) {
        Ok(written) if written == out.len() => Ok(()),
        Ok(written) => Err(format!("zstd data that end after {written} bytes")),
        // A chunk may have more rows than needed, which the above rejects.
        Err(_) => {
            let mut reader = zstd::Decoder::with_buffer(raw).map_err(wrong)?;
            std::io::Read::read_exact(&mut reader, out).map_err(wrong)
        }
    }
}

fn unlzw(states: &mut States, raw: &[u8], out: &mut [u8]) -> Result<(), String> {
    use weezl::{BitOrder, LzwStatus, decode::Configuration};

    // Every stream begins with the "clear" code, 256. The bytes begin with 0 and an odd byte only
    // if the first version of libtiff wrote it, as 9 bits from the lowest up.
    let mut old;
    let state = if matches!(raw, [0, second, ..] if second & 1 == 1) {
        old = Configuration::new(BitOrder::Lsb, 8).with_yield_on_full_buffer(true).build();
        &mut old
    } else {
        states.lzw.get_or_insert_with(|| {
            Configuration::with_tiff_size_switch(BitOrder::Msb, 8).with_yield_on_full_buffer(true).build()
        })
    };
    state.reset();
    let (mut read, mut written) = (0, 0);
    while written < out.len() {
        let step = state.decode_bytes(&raw[read..], &mut out[written..]);
        (read, written) = (read + step.consumed_in, written + step.consumed_out);
        match step.status {
            Ok(LzwStatus::Ok) => {}
            Ok(LzwStatus::NoProgress | LzwStatus::Done) => break,
            Err(error) => return Err(format!("bad LZW data ({error})")),
        }
    }
    if written < out.len() {
        return Err(format!("LZW data that end after {written} bytes"));
    }
    Ok(())
}

fn same_size(shape: ChunkShape, width: usize, rows: usize) -> Result<(), String> {
    if width == shape.width && (shape.rows..=shape.max_rows).contains(&rows) {
        return Ok(());
    }
    Err(format!("an image of {width}x{rows} in a chunk of {}x{}", shape.width, shape.rows))
}

/// A little-endian TIFF file whose only strip is `raw`.
fn one_strip(raw: &[u8], [width, rows, bits, compression, samples]: [usize; 5], tables: &[u8]) -> Vec<u8> {
    const ENTRIES: usize = 10;
    let tables_at = 8 + 2 + ENTRIES * 12 + 4;
    let raw_at = tables_at + tables.len().max(4);
    let entries: [(u16, u16, usize, usize); ENTRIES] = [
        (tag::IMAGE_WIDTH, LONG, 1, width),
        (tag::IMAGE_LENGTH, LONG, 1, rows),
        (tag::BITS_PER_SAMPLE, SHORT, 1, bits),
        (tag::COMPRESSION, SHORT, 1, compression),
        (tag::PHOTOMETRIC_INTERPRETATION, SHORT, 1, photometric::BLACK_IS_ZERO as usize),
        (tag::STRIP_OFFSETS, LONG, 1, raw_at),
        (tag::SAMPLES_PER_PIXEL, SHORT, 1, samples),
        (tag::ROWS_PER_STRIP, LONG, 1, rows),
        (tag::STRIP_BYTE_COUNTS, LONG, 1, raw.len()),
        if tables.is_empty() {
            (tag::SOFTWARE, ASCII, 1, 0)
        } else {
            (tag::JPEG_TABLES, UNDEFINED, tables.len(), tables_at)
        },
    ];
    let mut file = Vec::with_capacity(raw_at + raw.len());
    file.extend(b"II*\0\x08\0\0\0");
    file.extend((ENTRIES as u16).to_le_bytes());
    for (tag, kind, count, value) in entries {
        file.extend(tag.to_le_bytes());
        file.extend(kind.to_le_bytes());
        file.extend((count as u32).to_le_bytes());
        file.extend((value as u32).to_le_bytes());
    }
    file.resize(tables_at, 0);
    file.extend(tables);
    file.resize(raw_at, 0);
    file.extend(raw);
    file
}

/// Frame header of a JPEG stream.
struct JpegFrame {
    bits: u8,
    width: usize,
    rows: usize,
    components: usize,
}

impl JpegFrame {
    fn find(jpeg: &[u8]) -> Option<JpegFrame> {
        let mut at = 2;
        loop {
            let rest = jpeg.get(at..)?;
            match *rest {
                [0xff, 0xff, ..] => at += 1,
                // Start of frame of any type; the codes between the ranges are other segments.
                [
                    0xff,
                    0xc0..=0xc3 | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf,
                    _,
                    _,
                    bits,
                    a,
                    b,
                    c,
                    d,
                    n,
                    ..,
                ] => {
                    return Some(JpegFrame {
                        bits,
                        width: u16::from_be_bytes([c, d]).into(),
                        rows: u16::from_be_bytes([a, b]).into(),
                        components: n.into(),
                    });
                }
                [0xff, _, a, b, ..] => at += 2 + usize::from(u16::from_be_bytes([a, b])),
                _ => return None,
            }
        }
    }
}

/// The size of a WebP image.
fn webp_size(webp: &[u8]) -> Option<(usize, usize)> {
    let number = |at: usize, bytes: usize| -> Option<usize> {
        Some(webp.get(at..at + bytes)?.iter().rev().fold(0, |n, byte| n << 8 | *byte as usize))
    };
    Some(match webp.get(12..16)? {
        b"VP8X" => (number(24, 3)? + 1, number(27, 3)? + 1),
        b"VP8L" => {
            let size = number(21, 4)?;
            ((size & 0x3fff) + 1, (size >> 14 & 0x3fff) + 1)
        }
        b"VP8 " => (number(26, 2)? & 0x3fff, number(28, 2)? & 0x3fff),
        _ => return None,
    })
}

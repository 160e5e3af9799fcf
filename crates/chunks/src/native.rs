//! Codecs with C code, and those of the `tiff` crate. It gets an in-memory file whose only strip is
//! the chunk, with bytes as samples, so that it decompresses and does nothing else.

use std::io::Cursor;

use tiff::decoder::{Decoder, Limits};

use crate::spec::field_type::{ASCII, LONG, SHORT, UNDEFINED};
use crate::spec::{compression as scheme, photometric, tag};
use crate::{ChunkFormat, Compression};

/// State of the zstd decoder.
#[derive(Default)]
pub(crate) struct ZstdState(Option<zstd::bulk::Decompressor<'static>>);

/// Whether this build decodes a compression.
pub(crate) fn supports(_: &Compression) -> bool {
    true
}

/// Shape of a decoded chunk.
#[derive(Clone, Copy, Debug)]
struct ChunkShape {
    /// Pixels per row.
    width: usize,
    rows: usize,
    /// Maximum number of rows in the compressed data: the last strip may be as high as the others.
    max_rows: usize,
    /// Samples per pixel in this chunk.
    samples: usize,
    /// Bytes per row.
    row_bytes: usize,
}

impl ChunkShape {
    /// The shape of a chunk of `rows` rows, before colour conversion.
    fn new(format: &ChunkFormat, rows: usize) -> ChunkShape {
        let (rows, row_bytes) = format.packed(rows);
        ChunkShape {
            width: format.chunk_width as usize,
            rows,
            max_rows: format.chunk_height as usize,
            samples: format.chunk_samples(),
            row_bytes,
        }
    }
}

pub(crate) fn unzstd(state: &mut ZstdState, raw: &[u8], out: &mut [u8]) -> Result<(), String> {
    let wrong = |error| format!("bad zstd data ({error})");
    if state.0.is_none() {
        state.0 = Some(zstd::bulk::Decompressor::new().map_err(wrong)?);
    }
    let decoder = state.0.as_mut().expect("created above");
    match decoder.decompress_to_buffer(raw, out) {
        Ok(written) if written == out.len() => Ok(()),
        Ok(written) => Err(format!("zstd data that end after {written} bytes")),
        // A chunk may have more rows than needed, which the above rejects.
        Err(_) => {
            let mut reader = zstd::Decoder::with_buffer(raw).map_err(wrong)?;
            std::io::Read::read_exact(&mut reader, out).map_err(wrong)
        }
    }
}

/// Decompresses a chunk of `rows` rows to fill `out`, with the `tiff` crate.
pub(crate) fn decompress(
    format: &ChunkFormat,
    raw: &[u8],
    rows: usize,
    out: &mut [u8],
) -> Result<(), String> {
    let compression = &format.compression;
    let shape = ChunkShape::new(format, rows);
    match compression {
        Compression::WebP => {
            let (width, rows) = webp_size(raw).ok_or("no WebP header")?;
            same_size(shape, width, rows)?;
            by_crate(compression, raw, ChunkShape { rows, ..shape }, out)
        }
        Compression::Jpeg(tables) => {
            let frame = JpegFrame::find(raw).ok_or("no JPEG frame header")?;
            if frame.bits != 8 {
                return Err(format!("JPEG samples of {} bits, of which only 8 are supported", frame.bits));
            }
            if frame.components != shape.samples {
                return Err(format!("a JPEG image of {} components", frame.components));
            }
            same_size(shape, frame.width, frame.rows)?;
            if !tables.is_empty() && (tables.len() < 4 || raw.len() < 2) {
                return Err("too short JPEG tables".into());
            }
            by_crate(compression, raw, ChunkShape { rows: frame.rows, ..shape }, out)
        }
        _ => by_crate(compression, raw, shape, out),
    }
}

/// Decodes with the `tiff` crate.
fn by_crate(compression: &Compression, raw: &[u8], shape: ChunkShape, out: &mut [u8]) -> Result<(), String> {
    let ChunkShape { width, rows, samples, row_bytes, .. } = shape;
    let (code, width, bits, samples) = match compression {
        Compression::Fax4 => (scheme::CCITT_GROUP_4, width, 1, 1),
        Compression::Jpeg(_) => (scheme::JPEG, width, 8, samples),
        Compression::WebP => (scheme::WEBP, width, 8, samples),
        _ => (scheme::PACK_BITS, row_bytes, 8, 1),
    };
    let tables: &[u8] = if let Compression::Jpeg(tables) = compression { tables } else { &[] };
    let file = one_strip(raw, [width, rows, bits, code as usize, samples], tables);
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
    decode().map_err(|error| format!("bad {} data ({error})", compression.name()))
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

//! Decompression of single chunks.
//!
//! Chunks compressed with deflate, zstd or LZW, the usual ones, are decoded directly into their
//! buffer, with decoder states that are reused for all chunks. The feature `native` adds the other
//! codecs and a faster one for zstd (see `native.rs`, otherwise `portable.rs`).

use serde::{Deserialize, Serialize};

use crate::ChunkFormat;
#[cfg(feature = "native")]
use crate::native as platform;
#[cfg(not(feature = "native"))]
use crate::portable as platform;
use crate::spec::compression as scheme;
pub(crate) use platform::supports;

/// Name and version of the decoder of JPEG chunks, as locked in `Cargo.lock`. Decoders, and their
/// versions, may differ in the lowest bits of a sample.
const JPEG_DECODER: &str = "zune-jpeg 0.5.15";
/// Name and version of the decoder of WebP chunks.
const WEBP_DECODER: &str = "image-webp 0.2.4";

/// Compression of chunks.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Compression {
    /// Plain samples.
    None,
    /// A zlib stream.
    Deflate,
    /// Zstandard frames.
    Zstd,
    /// TIFF's variant of LZW, or that of the first version of libtiff.
    Lzw,
    /// Run lengths of bytes.
    PackBits,
    /// CCITT group 4 fax.
    Fax4,
    /// A WebP image.
    WebP,
    /// A JPEG image, with tables that are shared by all chunks; may be empty.
    Jpeg(Vec<u8>),
}

/// Decoder states that are expensive to create, and a buffer; used by one thread at a time.
#[derive(Default)]
pub struct DecoderStates {
    inflate: Option<flate2::Decompress>,
    zstd: platform::ZstdState,
    lzw: Option<weezl::decode::Decoder>,
    pub(crate) row: Vec<u8>,
}

impl Compression {
    /// The codec for a value of the tag Compression, and the content of the tag JPEGTables.
    ///
    /// # Errors
    /// Names an unsupported codec.
    pub fn new(compression: u64, jpeg_tables: Option<Vec<u8>>) -> Result<Compression, String> {
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
                    scheme::CCITT_RLE => "CCITT RLE",
                    scheme::CCITT_GROUP_3 => "CCITT group 3 fax",
                    scheme::OLD_JPEG => "old-style JPEG",
                    scheme::NEXT => "NeXT",
                    scheme::THUNDERSCAN => "ThunderScan",
                    scheme::SGI_LOG | scheme::SGI_LOG_24 => "SGI LogLuv",
                    scheme::JPEG_2000 => "JPEG 2000",
                    scheme::LERC => "LERC",
                    scheme::LZMA => "LZMA",
                    scheme::JPEG_XL => "JPEG XL",
                    _ => "unknown",
                };
                return Err(format!("compression {other} ({name})"));
            }
        })
    }

    /// Name of the codec.
    pub fn name(&self) -> &'static str {
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
    pub fn has_predictor(&self) -> bool {
        matches!(self, Compression::Deflate | Compression::Zstd | Compression::Lzw)
    }

    /// Whether the codec has a bit order of its own, so that FillOrder does not apply.
    pub fn ignores_fill_order(&self) -> bool {
        matches!(self, Compression::Jpeg(_) | Compression::WebP)
    }

    /// Name and version of the decoder, if the compression is lossy.
    pub(crate) fn lossy_decoder(&self) -> Option<&'static str> {
        match self {
            Compression::Jpeg(_) => Some(JPEG_DECODER),
            // (Or lossless, which only each chunk says.)
            Compression::WebP => Some(WEBP_DECODER),
            _ => None,
        }
    }
}

/// Decompresses a chunk of `rows` rows to fill `out`.
///
/// # Errors
/// Describes what is wrong with the chunk.
pub(crate) fn decompress(
    format: &ChunkFormat,
    states: &mut DecoderStates,
    raw: &[u8],
    rows: usize,
    out: &mut [u8],
) -> Result<(), String> {
    match format.compression {
        Compression::None => {
            let samples = raw.get(..out.len()).ok_or_else(|| format!("only {} bytes", raw.len()))?;
            out.copy_from_slice(samples);
            Ok(())
        }
        Compression::Deflate => inflate(states, raw, out),
        Compression::Zstd => platform::unzstd(&mut states.zstd, raw, out),
        Compression::Lzw => unlzw(states, raw, out),
        _ => platform::decompress(format, raw, rows, out),
    }
}

fn inflate(states: &mut DecoderStates, raw: &[u8], out: &mut [u8]) -> Result<(), String> {
    let state = states.inflate.get_or_insert_with(|| flate2::Decompress::new(true));
    state.reset(true);
    let result = state.decompress(raw, out, flate2::FlushDecompress::Finish);
    match (state.total_out() == out.len() as u64, result) {
        (true, Ok(_)) => Ok(()),
        (_, Err(error)) => Err(format!("bad deflate data ({error})")),
        (false, Ok(_)) => Err(format!("deflate data that end after {} bytes", state.total_out())),
    }
}

fn unlzw(states: &mut DecoderStates, raw: &[u8], out: &mut [u8]) -> Result<(), String> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_of_lossy_decoders_are_those_in_use() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../Cargo.lock");
        // (The published crate has no such file.)
        let Ok(lock) = std::fs::read_to_string(path) else { return };
        for decoder in [JPEG_DECODER, WEBP_DECODER] {
            let (name, version) = decoder.split_once(' ').unwrap();
            let name = format!("name = \"{name}\"\nversion = ");
            let versions: Vec<&str> =
                lock.split(&name).skip(1).filter_map(|rest| rest.lines().next()).collect();
            assert_eq!(versions, [format!("\"{version}\"")], "update the constant of {decoder}");
        }
    }
}

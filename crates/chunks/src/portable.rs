//! Codecs for builds without C code: zstd in Rust, with the feature `portable`. Others are refused.

use crate::{ChunkFormat, Compression};

/// State of the zstd decoder.
#[derive(Default)]
pub(crate) struct ZstdState {
    #[cfg(feature = "portable")]
    decoder: Option<ruzstd::decoding::FrameDecoder>,
}

/// Whether this build decodes a compression.
pub(crate) fn supports(compression: &Compression) -> bool {
    match compression {
        Compression::None | Compression::Deflate | Compression::Lzw => true,
        Compression::Zstd => cfg!(feature = "portable"),
        Compression::PackBits | Compression::Fax4 | Compression::WebP | Compression::Jpeg(_) => false,
    }
}

/// Refuses a chunk.
pub(crate) fn decompress(
    format: &ChunkFormat,
    _raw: &[u8],
    _rows: usize,
    _out: &mut [u8],
) -> Result<(), String> {
    Err(refusal(&format.compression))
}

fn refusal(compression: &Compression) -> String {
    format!("{} compression, which this build of Spinney cannot decode", compression.name())
}

#[cfg(not(feature = "portable"))]
pub(crate) fn unzstd(_state: &mut ZstdState, _raw: &[u8], _out: &mut [u8]) -> Result<(), String> {
    Err(refusal(&Compression::Zstd))
}

/// Decodes frames until `out` is full. As with libzstd, data may follow.
#[cfg(feature = "portable")]
pub(crate) fn unzstd(state: &mut ZstdState, raw: &[u8], out: &mut [u8]) -> Result<(), String> {
    use ruzstd::decoding::errors::{FrameDecoderError, ReadFrameHeaderError};
    use ruzstd::decoding::{BlockDecodingStrategy, FrameDecoder};
    use std::io::Read;

    let wrong = |error: &dyn std::fmt::Display| format!("bad zstd data ({error})");
    let decoder = state.decoder.get_or_insert_with(FrameDecoder::new);
    let (mut rest, mut written) = (raw, 0);
    while written < out.len() && !rest.is_empty() {
        match decoder.init(&mut rest) {
            Ok(()) => {}
            Err(FrameDecoderError::ReadFrameHeaderError(ReadFrameHeaderError::SkipFrame {
                length, ..
            })) => {
                rest = rest.get(length as usize..).ok_or_else(|| wrong(&"a skipped frame is too short"))?;
                continue;
            }
            Err(error) => return Err(wrong(&error)),
        }
        let mut ended = false;
        while written < out.len() && !ended {
            if !decoder.is_finished() {
                let step = BlockDecodingStrategy::UptoBlocks(1);
                decoder.decode_blocks(&mut rest, step).map_err(|error| wrong(&error))?;
            }
            written += decoder.read(&mut out[written..]).map_err(|error| wrong(&error))?;
            ended = decoder.is_finished() && decoder.can_collect() == 0;
        }
        let stored = decoder.get_checksum_from_data();
        if ended && stored.is_some() && stored != decoder.get_calculated_checksum() {
            return Err(wrong(&"wrong checksum"));
        }
    }
    if written < out.len() {
        return Err(format!("zstd data that end after {written} bytes"));
    }
    Ok(())
}

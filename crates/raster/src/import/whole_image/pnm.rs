//! PNM: PBM, PGM, PPM and PAM, with samples as the file stores them.
//!
//! The decoder scales samples to the full range of 8 or 16 bits. So it gets a header whose maximum
//! is that range, followed by the file's samples.

use std::io::{self, BufReader, Chain, Cursor, Read, Seek, SeekFrom, Take};

use image::codecs::pnm::{
    ArbitraryHeader, ArbitraryTuplType, GraymapHeader, PixmapHeader, PnmDecoder, PnmHeader, PnmSubtype,
    SampleEncoding,
};
use image::{ImageDecoder, ImageResult};

use super::MAX_TEXT_HEADER;
use crate::import::RasterInfo;
use spinney_base::io::InputFile;
use spinney_base::value::SampleType;

/// Decodes samples without scaling, except for single bits: 0 is black, 255 is white.
pub(super) type Decoder = PnmDecoder<Chain<Cursor<Vec<u8>>, BufReader<Take<InputFile>>>>;

/// Properties from a file's header.
pub(super) struct Header {
    subtype: PnmSubtype,
    /// Maximum sample that the header declares.
    maximum: u32,
    has_bits: bool,
    /// Offset of the first byte after the samples, unless they are text.
    end: Option<u64>,
}

/// Whether a file starts as PNM.
pub(super) fn is_pnm(start: &[u8]) -> bool {
    matches!(start, [b'P', b'1'..=b'7', b' ' | b'\t' | b'\n' | b'\r' | b'#', ..])
}

/// A decoder of the first image in a file.
pub(super) fn unscaled(file: InputFile) -> ImageResult<(Decoder, Header)> {
    let start = BufReader::with_capacity(1 << 16, file.take(MAX_TEXT_HEADER));
    let (mut rest, header) = PnmDecoder::new(start)?.into_inner();
    let header_bytes = MAX_TEXT_HEADER - rest.get_ref().limit() - rest.buffer().len() as u64;
    rest.get_mut().set_limit(u64::MAX);

    let (full, has_bits) = full_range(&header);
    let mut text = Vec::new();
    full.write(&mut text)?;
    let decoder = PnmDecoder::new(Cursor::new(text).chain(rest))?;
    let subtype = header.subtype();
    let (width, height) = (u64::from(header.width()), u64::from(header.height()));
    let sample_bytes = match subtype {
        PnmSubtype::Bitmap(_) => width.div_ceil(8) * height,
        _ => decoder.total_bytes(),
    };
    let is_binary = subtype.sample_encoding() == SampleEncoding::Binary;
    let end = is_binary.then(|| header_bytes.saturating_add(sample_bytes));
    Ok((decoder, Header { subtype, maximum: header.maximal_sample(), has_bits, end }))
}

/// The header of the same image with the maximum sample of the sample's type, and whether samples
/// are single bits.
fn full_range(header: &PnmHeader) -> (PnmHeader, bool) {
    let full = if header.maximal_sample() > 0xff { 0xffff } else { 0xff };
    if let Some(gray) = header.as_graymap() {
        (GraymapHeader { maxwhite: full, ..*gray }.into(), false)
    } else if let Some(pixmap) = header.as_pixmap() {
        (PixmapHeader { maxval: full, ..*pixmap }.into(), false)
    } else if let Some(arbitrary) = header.as_arbitrary() {
        use ArbitraryTuplType::*;
        // Without a type, the decoder would take 16 bits for 8.
        let kind = arbitrary.tupltype.clone().or(match arbitrary.depth {
            1 => Some(Grayscale),
            2 => Some(GrayscaleAlpha),
            3 => Some(RGB),
            4 => Some(RGBAlpha),
            _ => None,
        });
        let has_bits = matches!(kind, Some(BlackAndWhite | BlackAndWhiteAlpha));
        let maxval = if has_bits { arbitrary.maxval } else { full };
        (ArbitraryHeader { tupltype: kind, maxval, ..arbitrary.clone() }.into(), has_bits)
    } else {
        (header.clone(), true)
    }
}

impl Header {
    /// Offset of the first byte after the samples, unless they are text.
    pub(super) fn end(&self) -> Option<u64> {
        self.end
    }

    /// Name of the stored type of samples.
    pub(super) fn stored_sample(&self, sample: SampleType) -> String {
        match self.maximum {
            0xff | 0xffff => sample.name().into(),
            maximum => format!("uint{}", maximum.ilog2() + 1),
        }
    }

    pub(super) fn layout(&self) -> String {
        let name = match self.subtype {
            PnmSubtype::Bitmap(_) => "PBM",
            PnmSubtype::Graymap(_) => "PGM",
            PnmSubtype::Pixmap(_) => "PPM",
            PnmSubtype::ArbitraryMap => "PAM",
        };
        let text = if self.subtype.sample_encoding() == SampleEncoding::Ascii { ", text" } else { "" };
        let maximum = match self.maximum {
            1 | 0xff | 0xffff => String::new(),
            maximum => format!(", maximum {maximum}"),
        };
        format!("{name}{text}{maximum}")
    }

    /// Warns of further images in the file.
    pub(super) fn remark(&self, mut file: BufReader<InputFile>) -> io::Result<Option<String>> {
        let Some(end) = self.end else { return Ok(None) };
        file.seek(SeekFrom::Start(end))?;
        let mut next = Vec::new();
        file.take(3).read_to_end(&mut next)?;
        Ok(is_pnm(&next).then(|| "images after the first are not read".into()))
    }

    /// Checks that samples are at most the declared maximum, and scales opacity, which is relative
    /// to it, to the full range of the type.
    ///
    /// # Errors
    /// Description of the first sample above the maximum, if any.
    pub(super) fn check_samples(&self, mut samples: Vec<u8>, info: &RasterInfo) -> Result<Vec<u8>, String> {
        let full = if info.sample == SampleType::U8 { 0xff } else { 0xffff };
        if self.has_bits || self.maximum == full {
            return Ok(samples);
        }
        let size = info.sample.size();
        for (index, sample) in samples.chunks_exact_mut(size).enumerate() {
            let value = sample.iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte));
            if value > self.maximum {
                return Err(format!("a sample of {value}, above the maximum {}", self.maximum));
            }
            if info.alpha == Some(index % info.channels) {
                let opacity = (value * full + self.maximum / 2) / self.maximum;
                sample.copy_from_slice(&opacity.to_le_bytes()[..size]);
            }
        }
        Ok(samples)
    }
}

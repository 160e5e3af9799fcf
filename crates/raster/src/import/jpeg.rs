//! Reader of JPEG, decoded as a whole.

use std::io::Read;
use std::path::Path;

use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;

use super::whole_image::WholeImage;
use super::{Raster, RasterInfo, RasterOptions};
use spinney_base::guard::guard;
use spinney_base::io::FileAccess;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};

pub(super) fn open(path: &Path, options: &RasterOptions) -> Result<Box<dyn Raster>> {
    let bytes = options.access.input(path)?.len();
    options.check_memory(path, "the compressed image", bytes)?;
    let info = with_jpeg((path, &options.access), |bytes, decoder| {
        let progressive = check_complete(path, bytes)?;
        let image = decoder.info().ok_or_else(|| corrupt(path, "no frame header"))?;
        let channels = if decoder.input_colorspace() == Some(ColorSpace::Luma) { 1 } else { 3 };
        let size = [image.width.into(), image.height.into()];
        let layout = if progressive { "JPEG, progressive" } else { "JPEG" };
        let info = RasterInfo::plain(size, SampleType::U8, channels).in_colour();
        Ok(RasterInfo { layout: layout.into(), ..info })
    })?;
    let (file, access) = (path.to_path_buf(), options.access.clone());
    WholeImage::open(path, options, info, move |info| {
        with_jpeg((&file, &access), |_, decoder| {
            let mut decoded = vec![0; (info.width * info.height) as usize * info.channels];
            decoder.decode_into(&mut decoded).map_err(|error| jpeg_error(&file, &error))?;
            Ok(decoded)
        })
    })
}

/// Runs `then` with a JPEG file's bytes and a decoder that has read its headers and outputs grey or
/// RGB.
fn with_jpeg<T>(
    (path, access): (&Path, &FileAccess),
    then: impl FnOnce(&[u8], &mut JpegDecoder<ZCursor<&[u8]>>) -> Result<T>,
) -> Result<T> {
    let mut bytes = Vec::new();
    access.input(path)?.read_to_end(&mut bytes).map_err(Error::io(path, "read"))?;
    guard(path, "JPEG data", || {
        // Strict, or corrupt data would silently become grey pixels.
        let options = DecoderOptions::new_fast()
            .set_strict_mode(true)
            .set_max_width(usize::from(u16::MAX))
            .set_max_height(usize::from(u16::MAX));
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes.as_slice()), options);
        decoder.decode_headers().map_err(|error| jpeg_error(path, &error))?;
        let wanted = match decoder.input_colorspace() {
            Some(ColorSpace::Luma) => ColorSpace::Luma,
            _ => ColorSpace::RGB,
        };
        decoder.set_options(options.jpeg_set_out_colorspace(wanted));
        then(&bytes, &mut decoder)
    })
}

/// Scans a JPEG's segments for its end marker, which the decoder does not require. Returns whether
/// the image is progressive.
fn check_complete(path: &Path, bytes: &[u8]) -> Result<bool> {
    const SOF2: u8 = 0xc2;
    const EOI: u8 = 0xd9;
    let mut progressive = false;
    let mut at = 2;
    loop {
        // Skip to the next marker: 0xff and a code. In compressed data, 0xff 0x00 and restart
        // markers are not segments.
        at += bytes
            .get(at..)
            .and_then(|rest| rest.iter().position(|&b| b == 0xff))
            .ok_or_else(|| truncated(path, bytes))?;
        match bytes.get(at + 1).ok_or_else(|| truncated(path, bytes))? {
            &EOI => return Ok(progressive),
            0xff => at += 1,
            0x00 | 0x01 | 0xd0..=0xd7 => at += 2,
            &code => {
                progressive |= code == SOF2;
                let length = bytes.get(at + 2..at + 4).ok_or_else(|| truncated(path, bytes))?;
                at += 2 + usize::from(u16::from_be_bytes([length[0], length[1]]));
            }
        }
    }
}

fn truncated(path: &Path, bytes: &[u8]) -> Error {
    Error::corrupt(
        path,
        "JPEG data",
        format!("the end of the file at byte {}", bytes.len()),
        "the end marker",
    )
}

fn corrupt(path: &Path, found: impl Into<String>) -> Error {
    Error::corrupt(path, "JPEG data", found, "a valid JPEG image")
}

fn jpeg_error(path: &Path, error: &DecodeErrors) -> Error {
    match error {
        DecodeErrors::Unsupported(scheme) => {
            Error::unsupported(path, format!("this kind of JPEG ({scheme:?})"), "convert it to PNG or TIFF")
        }
        other => corrupt(path, other.to_string()),
    }
}

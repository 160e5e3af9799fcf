//! JPEG and WebP: formats that decode only as a whole.

use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use image::ImageDecoder;
use image::codecs::webp::WebPDecoder;
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;

use super::{Pixels, Raster, RasterInfo, RasterOptions};
use spinney_base::guard::guard;
use spinney_base::io::InputFile;
use spinney_base::space::Region;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};

/// A picture that is decoded at the first read and then kept.
struct Picture {
    path: PathBuf,
    info: RasterInfo,
    decode: fn(&Path, &RasterInfo) -> Result<Vec<u8>>,
    decoded: Option<Vec<u8>>,
}

impl Picture {
    /// Opens a picture after making sure that it fits the memory.
    ///
    /// Only the decoded picture counts, which stays; while it is being decoded, progressive JPEG needs
    /// up to three times as much and WebP up to twice.
    fn open(
        path: &Path,
        options: &RasterOptions,
        info: RasterInfo,
        decode: fn(&Path, &RasterInfo) -> Result<Vec<u8>>,
    ) -> Result<Box<dyn Raster>> {
        let bytes = (info.width * info.height).saturating_mul(info.pixel_bytes() as u64);
        options.check_memory(path, "decoding the whole picture, which this format asks for,", bytes)?;
        Ok(Box::new(Picture { path: path.to_path_buf(), info, decode, decoded: None }))
    }
}

impl Raster for Picture {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.info.check(region)?;
        let decoded = match &mut self.decoded {
            Some(decoded) => decoded,
            none => none.insert((self.decode)(&self.path, &self.info)?),
        };
        let pixel = self.info.pixel_bytes();
        let stride = self.info.width as usize * pixel;
        pixels.valid = None;
        pixels.bytes.clear();
        for y in region.y as usize..region.bottom() as usize {
            let row = &decoded[y * stride..][..stride];
            pixels.bytes.extend_from_slice(&row[region.x as usize * pixel..region.right() as usize * pixel]);
        }
        Ok(())
    }
}

pub(super) fn open_jpeg(path: &Path, options: &RasterOptions) -> Result<Box<dyn Raster>> {
    let bytes = InputFile::open(path)?.len();
    options.check_memory(path, "the compressed picture", bytes)?;
    let info = with_jpeg(path, |bytes, decoder| {
        let progressive = check_complete(path, bytes)?;
        let image = decoder.info().ok_or_else(|| damaged(path, "no frame header"))?;
        let channels = if decoder.input_colorspace() == Some(ColorSpace::Luma) { 1 } else { 3 };
        let size = [image.width.into(), image.height.into()];
        let layout = if progressive { "JPEG, progressive" } else { "JPEG" };
        let info = RasterInfo::plain(size, SampleType::U8, channels).in_colour();
        Ok(RasterInfo { layout: layout.into(), ..info })
    })?;
    Picture::open(path, options, info, |path, info| {
        with_jpeg(path, |_, decoder| {
            let mut decoded = vec![0; (info.width * info.height) as usize * info.channels];
            decoder.decode_into(&mut decoded).map_err(|error| jpeg_error(path, &error))?;
            Ok(decoded)
        })
    })
}

/// Runs `then` with a JPEG file's bytes and a decoder that knows its headers and gives grey or RGB.
fn with_jpeg<T>(
    path: &Path,
    then: impl FnOnce(&[u8], &mut JpegDecoder<ZCursor<&[u8]>>) -> Result<T>,
) -> Result<T> {
    let mut bytes = Vec::new();
    InputFile::open(path)?.read_to_end(&mut bytes).map_err(Error::io(path, "read"))?;
    guard(path, "JPEG data", || {
        // Strict, or damage would become grey pixels without a word.
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

/// Walks over a JPEG's segments to its end marker, which the decoder does not insist on; tells whether the
/// picture is progressive.
fn check_complete(path: &Path, bytes: &[u8]) -> Result<bool> {
    const SOF2: u8 = 0xc2;
    const EOI: u8 = 0xd9;
    let mut progressive = false;
    let mut at = 2;
    loop {
        // To the next marker: 0xff and a code; in compressed data 0xff 0x00 and restart marks are no
        // segments.
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

fn damaged(path: &Path, found: impl Into<String>) -> Error {
    Error::corrupt(path, "JPEG data", found, "a valid JPEG picture")
}

fn jpeg_error(path: &Path, error: &DecodeErrors) -> Error {
    match error {
        DecodeErrors::Unsupported(scheme) => {
            Error::unsupported(path, format!("this kind of JPEG ({scheme:?})"), "convert it to PNG or TIFF")
        }
        other => damaged(path, other.to_string()),
    }
}

pub(super) fn open_webp(path: &Path, options: &RasterOptions) -> Result<Box<dyn Raster>> {
    let info = with_webp(path, |decoder| {
        if decoder.has_animation() {
            return Err(Error::unsupported(path, "an animated WebP", "extract one picture of it"));
        }
        let (width, height) = decoder.dimensions();
        let channels = usize::from(decoder.color_type().channel_count());
        Ok(RasterInfo {
            alpha: (channels == 4).then_some(3),
            layout: "WebP".into(),
            ..RasterInfo::plain([width.into(), height.into()], SampleType::U8, channels)
        }
        .in_colour())
    })?;
    Picture::open(path, options, info, |path, info| {
        with_webp(path, |decoder| {
            let mut decoded = vec![0; (info.width * info.height) as usize * info.channels];
            if decoder.total_bytes() != decoded.len() as u64 {
                return Err(webp_damaged(path, "another picture than a moment ago"));
            }
            decoder.read_image(&mut decoded).map_err(|error| webp_error(path, error))?;
            Ok(decoded)
        })
    })
}

/// Runs `then` with a WebP decoder that knows the headers.
fn with_webp<T>(path: &Path, then: impl FnOnce(WebPDecoder<BufReader<InputFile>>) -> Result<T>) -> Result<T> {
    let mut file = InputFile::open(path)?;
    // The decoder is content with less than the file says it has.
    let mut start = [0; 8];
    file.read_exact(&mut start).and_then(|()| file.rewind()).map_err(Error::io(path, "read"))?;
    let promised = 8 + u64::from(u32::from_le_bytes([start[4], start[5], start[6], start[7]]));
    let bytes = file.len();
    if bytes < promised {
        return Err(webp_damaged(path, format!("the end of the file at byte {bytes} of {promised}")));
    }
    guard(path, "WebP data", || {
        let decoder = WebPDecoder::new(BufReader::new(file)).map_err(|error| webp_error(path, error))?;
        then(decoder)
    })
}

fn webp_damaged(path: &Path, found: impl Into<String>) -> Error {
    Error::corrupt(path, "WebP data", found, "a valid WebP picture")
}

fn webp_error(path: &Path, error: image::ImageError) -> Error {
    match error {
        image::ImageError::IoError(error) if error.kind() != std::io::ErrorKind::UnexpectedEof => {
            Error::io(path, "read")(error)
        }
        image::ImageError::Unsupported(error) => {
            Error::unsupported(path, error.to_string(), "convert it to PNG or TIFF")
        }
        other => webp_damaged(path, other.to_string()),
    }
}

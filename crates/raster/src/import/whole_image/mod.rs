//! Images that are decoded as a whole, at the first read, and then kept in memory.
//!
//! The `image` crate decodes BMP, GIF, Radiance HDR, PNM, QOI, TGA and WebP. JPEG has its own
//! decoder, in `jpeg`.

mod gif;
mod pnm;

use std::collections::BTreeMap;
use std::io::{BufReader, ErrorKind, Read, Seek};
use std::path::{Path, PathBuf};

use image::codecs::bmp::BmpDecoder;
use image::codecs::gif::GifDecoder;
use image::codecs::hdr::{HdrDecoder, HdrMetadata};
use image::codecs::qoi::QoiDecoder;
use image::codecs::tga::TgaDecoder;
use image::codecs::webp::WebPDecoder;
use image::{ColorType, ImageDecoder, ImageError, ImageFormat, ImageResult, Limits};

use super::{Pixels, Raster, RasterInfo, RasterOptions};
use spinney_base::guard::guard;
use spinney_base::io::{FileAccess, InputFile, without_query};
use spinney_base::space::Region;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};

const ADVICE: &str = "convert it to PNG or TIFF";
/// Maximum size of a text header in bytes. The decoders would read it to the end of any file.
const MAX_TEXT_HEADER: u64 = 1 << 20;

/// Decodes all samples of a raster with these properties.
type Decode = Box<dyn Fn(&RasterInfo) -> Result<Vec<u8>> + Send>;

/// An image that is decoded at the first read and then kept.
pub(super) struct WholeImage {
    path: PathBuf,
    info: RasterInfo,
    decode: Decode,
    decoded: Option<Vec<u8>>,
}

impl WholeImage {
    /// Opens an image after checking that it fits the memory.
    ///
    /// Only the decoded image, which is kept, is counted. During decoding, progressive JPEG needs
    /// up to three times as much. WebP, TGA with a palette, and GIF whose first frame does not fill
    /// the image need up to twice as much.
    pub(super) fn open(
        path: &Path,
        options: &RasterOptions,
        info: RasterInfo,
        decode: impl Fn(&RasterInfo) -> Result<Vec<u8>> + Send + 'static,
    ) -> Result<Box<dyn Raster>> {
        let bytes = info.width.saturating_mul(info.height).saturating_mul(info.pixel_bytes() as u64);
        options.check_memory(path, "decoding the whole image, as this format requires,", bytes)?;
        let (path, decode) = (path.to_path_buf(), Box::new(decode));
        Ok(Box::new(WholeImage { path, info, decode, decoded: None }))
    }
}

impl Raster for WholeImage {
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
            none => none.insert((self.decode)(&self.info)?),
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

/// Returns the format of a file that the `image` crate decodes: by its first bytes, or for TGA,
/// which has no signature, by the file name extension.
pub(super) fn format_of(path: &Path, start: &[u8]) -> Option<ImageFormat> {
    match start {
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Some(ImageFormat::WebP),
        [b'G', b'I', b'F', b'8', b'7' | b'9', b'a', ..] => Some(ImageFormat::Gif),
        [b'q', b'o', b'i', b'f', ..] => Some(ImageFormat::Qoi),
        // Two letters alone would match text, so the size of the second header, which follows the
        // file header, is checked as well.
        [b'B', b'M', ..]
            if matches!(start.get(14..18), Some([12 | 40 | 52 | 56 | 64 | 108 | 124, 0, 0, 0])) =>
        {
            Some(ImageFormat::Bmp)
        }
        start if pnm::is_pnm(start) => Some(ImageFormat::Pnm),
        start if [&b"#?RADIANCE"[..], b"#?RGBE"].iter().any(|magic| start.starts_with(magic)) => {
            Some(ImageFormat::Hdr)
        }
        _ if without_query(path).extension().is_some_and(|e| e.eq_ignore_ascii_case("tga")) => {
            Some(ImageFormat::Tga)
        }
        _ => None,
    }
}

/// A file of one of these formats.
struct ImageFile {
    path: PathBuf,
    access: FileAccess,
    format: ImageFormat,
}

/// Opens a file of a format; `start` is its first bytes.
pub(super) fn open(
    path: &Path,
    format: ImageFormat,
    start: &[u8],
    options: &RasterOptions,
) -> Result<Box<dyn Raster>> {
    let file = ImageFile { path: path.to_path_buf(), access: options.access.clone(), format };
    let info = file.guarded(|| file.describe(start))?;
    if info.width == 0 || info.height == 0 {
        return Err(file.corrupt(format!("{} x {} pixels", info.width, info.height)));
    }
    let memory = options.memory;
    WholeImage::open(path, options, info, move |info| file.guarded(|| file.decode(info, memory)))
}

impl ImageFile {
    fn describe(&self, start: &[u8]) -> Result<RasterInfo> {
        let path = &self.path;
        let info = match self.format {
            ImageFormat::Bmp => RasterInfo {
                remark: bmp_remark(start),
                ..self.info_of(&self.decoder(BmpDecoder::new(self.reader()?))?, "BMP")?
            },
            ImageFormat::Gif => {
                let blocks = gif::scan(path, &mut self.reader()?)?;
                let info = self.info_of(&self.decoder(GifDecoder::new(self.reader()?))?, "GIF")?;
                RasterInfo { remark: blocks.remark(), tags: blocks.tags(), ..info }
            }
            ImageFormat::Hdr => {
                let header = HdrDecoder::new_nonstrict(self.reader()?.take(MAX_TEXT_HEADER));
                let decoder = self.decoder(header)?;
                RasterInfo {
                    stored_sample: "rgbe".into(),
                    tags: hdr_tags(&decoder.metadata()),
                    ..self.info_of(&decoder, "Radiance HDR")?
                }
            }
            ImageFormat::Pnm => {
                let (decoder, header) = self.pnm()?;
                let info = self.info_of(&decoder, "PNM")?;
                RasterInfo {
                    stored_sample: header.stored_sample(info.sample),
                    layout: header.layout(),
                    remark: header.remark(self.reader()?).map_err(Error::io(path, "read"))?,
                    ..info
                }
            }
            ImageFormat::Qoi => {
                let is_linear = start.get(13) == Some(&1);
                let layout = if is_linear { "QOI, linear colors" } else { "QOI" };
                self.info_of(&self.decoder(QoiDecoder::new(self.reader()?))?, layout)?
            }
            ImageFormat::Tga => self.info_of(&self.decoder(TgaDecoder::new(self.reader()?))?, "TGA")?,
            _ => {
                let decoder = self.webp()?;
                let remark = decoder.has_animation().then(|| "frames after the first are not read".into());
                RasterInfo { remark, ..self.info_of(&decoder, "WebP")? }
            }
        };
        Ok(info)
    }

    fn info_of(&self, decoder: &dyn ImageDecoder, layout: &str) -> Result<RasterInfo> {
        let (width, height) = decoder.dimensions();
        let (sample, channels) = match decoder.color_type() {
            ColorType::L8 => (SampleType::U8, 1),
            ColorType::La8 => (SampleType::U8, 2),
            ColorType::Rgb8 => (SampleType::U8, 3),
            ColorType::Rgba8 => (SampleType::U8, 4),
            ColorType::L16 => (SampleType::U16, 1),
            ColorType::La16 => (SampleType::U16, 2),
            ColorType::Rgb16 => (SampleType::U16, 3),
            ColorType::Rgba16 => (SampleType::U16, 4),
            ColorType::Rgb32F => (SampleType::F32, 3),
            other => return Err(Error::unsupported(&self.path, format!("{other:?} pixels"), ADVICE)),
        };
        let plain = RasterInfo::plain([width.into(), height.into()], sample, channels);
        let alpha = channels.is_multiple_of(2).then_some(channels - 1);
        Ok(RasterInfo { alpha, layout: layout.into(), ..plain }.in_colour())
    }

    /// Decodes all samples.
    fn decode(&self, info: &RasterInfo, memory: u64) -> Result<Vec<u8>> {
        let mut decoded = vec![0; info.width as usize * info.height as usize * info.pixel_bytes()];
        let mut limits = Limits::no_limits();
        limits.max_alloc = Some(memory.saturating_sub(decoded.len() as u64));
        let mut pnm_header = None;
        let mut decoder: Box<dyn ImageDecoder> = match self.format {
            ImageFormat::Bmp => Box::new(self.decoder(BmpDecoder::new(self.reader()?))?),
            ImageFormat::Gif => Box::new(self.decoder(GifDecoder::new(self.reader()?))?),
            ImageFormat::Hdr => Box::new(self.decoder(HdrDecoder::new_nonstrict(self.reader()?))?),
            ImageFormat::Pnm => {
                let (decoder, header) = self.pnm()?;
                pnm_header = Some(header);
                Box::new(decoder)
            }
            ImageFormat::Qoi => Box::new(self.decoder(QoiDecoder::new(self.reader()?))?),
            ImageFormat::Tga => Box::new(self.decoder(TgaDecoder::new(self.reader()?))?),
            _ => Box::new(self.webp()?),
        };
        if decoder.total_bytes() != decoded.len() as u64 {
            return Err(Error::Changed { path: self.path.clone(), what: "was overwritten" });
        }
        decoder.set_limits(limits).map_err(|error| self.error(error))?;
        decoder.read_image_boxed(&mut decoded).map_err(|error| self.error(error))?;
        if cfg!(target_endian = "big") {
            decoded.chunks_exact_mut(info.sample.size()).for_each(<[u8]>::reverse);
        }
        match pnm_header {
            Some(header) => header.check_samples(decoded, info).map_err(|found| self.corrupt(found)),
            None => Ok(decoded),
        }
    }

    fn reader(&self) -> Result<BufReader<InputFile>> {
        Ok(BufReader::with_capacity(1 << 16, self.access.input(&self.path)?))
    }

    /// Converts the error of creating a decoder.
    fn decoder<D>(&self, decoder: ImageResult<D>) -> Result<D> {
        decoder.map_err(|error| self.error(error))
    }

    fn pnm(&self) -> Result<(pnm::Decoder, pnm::Header)> {
        let file = self.access.input(&self.path)?;
        let bytes = file.len();
        let (decoder, header) = self.decoder(pnm::unscaled(file))?;
        match header.end() {
            Some(end) if end > bytes => Err(self.truncated(bytes, end)),
            _ => Ok((decoder, header)),
        }
    }

    fn webp(&self) -> Result<WebPDecoder<BufReader<InputFile>>> {
        let mut file = self.access.input(&self.path)?;
        // The decoder accepts less than the file's header announces.
        let mut start = [0; 8];
        file.read_exact(&mut start).and_then(|()| file.rewind()).map_err(Error::io(&self.path, "read"))?;
        let end = 8 + u64::from(u32::from_le_bytes([start[4], start[5], start[6], start[7]]));
        let bytes = file.len();
        if bytes < end {
            return Err(self.truncated(bytes, end));
        }
        self.decoder(WebPDecoder::new(BufReader::new(file)))
    }

    /// Runs `decode`; its panics become errors.
    fn guarded<T>(&self, decode: impl FnOnce() -> Result<T>) -> Result<T> {
        guard(&self.path, &format!("{} data", self.name()), decode)
    }

    fn truncated(&self, bytes: u64, end: u64) -> Error {
        self.corrupt(format!("the end of the file at byte {bytes} of {end}"))
    }

    fn corrupt(&self, found: impl Into<String>) -> Error {
        let name = self.name();
        Error::corrupt(&self.path, format!("{name} data"), found, format!("a valid {name} image"))
    }

    fn error(&self, error: ImageError) -> Error {
        match error {
            ImageError::IoError(error) if error.kind() == ErrorKind::UnexpectedEof => {
                self.corrupt("the end of the file")
            }
            ImageError::IoError(error) => Error::io(&self.path, "read")(error),
            ImageError::Unsupported(error) => Error::unsupported(&self.path, error.to_string(), ADVICE),
            ImageError::Limits(_) => {
                let found =
                    format!("a {} image that takes more memory to decode than the limit", self.name());
                Error::unsupported(&self.path, found, "allow more with --memory, or convert it to tiled TIFF")
            }
            other => self.corrupt(other.to_string()),
        }
    }

    fn name(&self) -> &'static str {
        match self.format {
            ImageFormat::Bmp => "BMP",
            ImageFormat::Gif => "GIF",
            ImageFormat::Hdr => "Radiance HDR",
            ImageFormat::Pnm => "PNM",
            ImageFormat::Qoi => "QOI",
            ImageFormat::Tga => "TGA",
            _ => "WebP",
        }
    }
}

/// Warns of masks of more than 8 bits, which the decoder reduces to 8.
fn bmp_remark(start: &[u8]) -> Option<String> {
    const BITFIELDS: u32 = 3;
    let word = |at: usize| Some(u32::from_le_bytes(start.get(at..at + 4)?.try_into().ok()?));
    let has_masks = word(14)? >= 40 && word(30)? == BITFIELDS;
    let is_wide =
        has_masks && (54..66).step_by(4).any(|at| word(at).is_some_and(|mask| mask.count_ones() > 8));
    is_wide.then(|| "bits of samples after the eighth are not read".into())
}

/// Variables of the header, such as `EXPOSURE`, and the commands that made the image. Samples are
/// not divided by them.
fn hdr_tags(metadata: &HdrMetadata) -> BTreeMap<String, String> {
    let mut tags = BTreeMap::<String, String>::new();
    for (name, value) in metadata.custom_attributes.iter().filter(|(name, _)| name != "FORMAT") {
        let name = if name.is_empty() { "commands" } else { name.as_str() };
        let tag = tags.entry(name.into()).or_default();
        if !tag.is_empty() {
            tag.push('\n');
        }
        tag.push_str(value.trim());
    }
    tags
}

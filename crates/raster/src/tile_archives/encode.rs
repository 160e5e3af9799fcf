//! Draws, paints and encodes tiles.

use std::collections::HashMap;
use std::str::FromStr;
use std::sync::{Arc, Mutex, PoisonError};

use super::png::{PngEncoder, PngPixels};
use super::walk::TileSpan;
use crate::image::array_header;
use spinney_base::parallel::Pool;
use spinney_base::value::{Number, Value, ValueType};
use spinney_base::{Error, Result};
use spinney_tiles::{TileContent, TileId, TilePainter, TilePixels, TileSamples, TileSource};

/// File format of the tiles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TileFormat {
    /// Indexed, grey or RGB, with opacity if needed.
    #[default]
    Png,
    /// Lossless; lossy with a quality, if the program was built with libwebp.
    Webp,
    /// Lossy and opaque: transparent pixels become white.
    Jpeg,
    /// Raw samples as a `NumPy` array.
    Npy,
    /// Raw samples as a TIFF file with one strip.
    Tiff,
}

impl TileFormat {
    /// The file name extension.
    pub fn extension(self) -> &'static str {
        match self {
            TileFormat::Png => "png",
            TileFormat::Webp => "webp",
            TileFormat::Jpeg => "jpg",
            TileFormat::Npy => "npy",
            TileFormat::Tiff => "tif",
        }
    }

    /// Whether tiles are samples, which are not painted.
    pub fn is_array(self) -> bool {
        matches!(self, TileFormat::Npy | TileFormat::Tiff)
    }
}

impl FromStr for TileFormat {
    type Err = Error;

    fn from_str(name: &str) -> Result<TileFormat> {
        Ok(match name.to_ascii_lowercase().as_str() {
            "png" => TileFormat::Png,
            "webp" => TileFormat::Webp,
            "jpg" | "jpeg" => TileFormat::Jpeg,
            "npy" => TileFormat::Npy,
            "tif" | "tiff" => TileFormat::Tiff,
            _ => return Err(Error::invalid("tile format", name, "png, webp, jpg, npy or tif")),
        })
    }
}

/// Encoding of tiles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TileEncoding {
    /// File format of the tiles.
    pub format: TileFormat,
    /// Effort of PNG compression, from 1 (fast) to 9 (small); a compromise by default.
    pub png_effort: Option<u8>,
    /// Quality of JPEG and of lossy WebP, 1 to 100.
    pub quality: Option<u8>,
}

/// Default quality of JPEG.
const QUALITY: u8 = 85;

/// The bytes of a tile, and their hash.
#[derive(Debug)]
pub(super) struct Encoded {
    pub(super) bytes: Vec<u8>,
    pub(super) hash: u128,
}

impl Encoded {
    pub(super) fn new(bytes: Vec<u8>) -> Encoded {
        let hash = xxhash_rust::xxh3::xxh3_128(&bytes);
        Encoded { bytes, hash }
    }
}

/// Draws, paints and encodes tiles; shared by all threads.
pub(super) struct TileEncoder<'a> {
    source: &'a dyn TileSource,
    painter: &'a TilePainter,
    encoding: TileEncoding,
    side: usize,
    /// The value of VOID cells in samples; `None` if every number may be a value.
    void: Option<Value>,
    scratch: Pool<Scratch>,
    /// Cached tiles of a single value, by the value.
    uniform: Mutex<HashMap<Value, Arc<Encoded>>>,
}

/// Maximum number of cached uniform tiles.
const MAX_UNIFORM: usize = 4096;

struct Scratch {
    samples: TileSamples,
    pixels: TilePixels,
    png: PngEncoder,
}

impl<'a> TileEncoder<'a> {
    pub(super) fn new(
        source: &'a dyn TileSource,
        painter: &'a TilePainter,
        encoding: TileEncoding,
        side: usize,
        void: Option<Number>,
    ) -> Result<TileEncoder<'a>> {
        if encoding.format == TileFormat::Webp && encoding.quality.is_some() && !cfg!(feature = "libwebp") {
            let expected = "none: this build writes lossless WebP only; JPEG tiles have a quality";
            return Err(Error::invalid("quality of WebP", "one", expected));
        }
        let void = void.map(|void| source.value_type().nearest_numbers(|_| void));
        let (scratch, uniform) = (Pool::default(), Mutex::default());
        Ok(TileEncoder { source, painter, encoding, side, void, scratch, uniform })
    }

    /// Width of the margin of cells that a tile's bytes depend on.
    pub(super) fn margin(&self) -> usize {
        if self.encoding.format.is_array() { 0 } else { self.painter.margin() }
    }

    /// Encodes the tile of a run, or returns `None` if it is empty, which only drawing shows.
    pub(super) fn encode(&self, run: &TileSpan) -> Result<Option<Arc<Encoded>>> {
        let tile = TileId::from_number(run.first).expect("spans have valid tile numbers");
        let Some(value) = run.uniform else {
            return Ok(self.with_scratch(|scratch| self.drawn(tile, scratch))?.map(Arc::new));
        };
        if let Some(known) = self.remembered().get(&value) {
            return Ok(Some(known.clone()));
        }
        let made = Arc::new(self.with_scratch(|scratch| {
            let side = self.side + 2 * self.margin();
            scratch.samples.fill(side, self.source.value_type().size(), Some(value));
            self.file(tile, scratch)
        })?);
        let mut remembered = self.remembered();
        if remembered.len() < MAX_UNIFORM {
            remembered.insert(value, made.clone());
        }
        Ok(Some(made))
    }

    fn remembered(&self) -> std::sync::MutexGuard<'_, HashMap<Value, Arc<Encoded>>> {
        self.uniform.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn with_scratch<R>(&self, job: impl FnOnce(&mut Scratch) -> Result<R>) -> Result<R> {
        let make = || {
            let png = PngEncoder::new(self.encoding.png_effort);
            Ok(Scratch { samples: TileSamples::default(), pixels: TilePixels::default(), png })
        };
        self.scratch.with(make, job)
    }

    fn drawn(&self, tile: TileId, scratch: &mut Scratch) -> Result<Option<Encoded>> {
        self.source.tile(tile, self.side, self.margin(), &mut scratch.samples)?;
        if !scratch.samples.valid.contains(&true) {
            return Ok(None);
        }
        self.file(tile, scratch).map(Some)
    }

    /// Encodes a tile whose samples are in `scratch`.
    fn file(&self, tile: TileId, scratch: &mut Scratch) -> Result<Encoded> {
        let side = self.side;
        let Scratch { samples, pixels, png } = scratch;
        if self.encoding.format.is_array() {
            let value = self.source.value_type();
            let void_cells = samples.values.chunks_exact_mut(value.size()).zip(&samples.valid);
            for (cell, _) in void_cells.filter(|(_, valid)| !**valid) {
                let void = self.void.ok_or_else(|| no_number(value))?;
                cell.copy_from_slice(&void.to_bytes()[..value.size()]);
            }
            return Ok(Encoded::new(match self.encoding.format {
                TileFormat::Npy => {
                    [array_header(value, &[side as u64; 2]).as_slice(), &samples.values].concat()
                }
                _ => super::tiff::tile(value, side, tile, self.void, &samples.values),
            }));
        }
        self.painter.paint(self.source, tile, samples, pixels)?;
        let mut bytes = Vec::new();
        match (self.encoding.format, self.painter.palette()) {
            (TileFormat::Png, Some(colours)) => {
                png.encode(PngPixels::Indexed(&pixels.indices, colours), side, &mut bytes);
            }
            (TileFormat::Png, None) => png.encode(PngPixels::Colours(&pixels.colours), side, &mut bytes),
            (format, palette) => {
                if let Some(colours) = palette {
                    pixels.colours.clear();
                    pixels.colours.extend(pixels.indices.iter().map(|index| colours[usize::from(*index)]));
                }
                let quality = self.encoding.quality;
                bytes = match format {
                    TileFormat::Jpeg => jpeg(&pixels.colours, side, quality.unwrap_or(QUALITY)),
                    _ => webp(&pixels.colours, side, quality),
                }
                .map_err(|cause| Error::invalid("tile", cause, "a tile that can be encoded"))?;
            }
        }
        Ok(Encoded::new(bytes))
    }
}

/// Encodes one tile with `side` pixels per side, or returns `None` if it is empty. VOID cells of
/// samples have the number `void` (see [`void_number`](crate::void_number)).
///
/// # Errors
/// If samples are VOID and have no number, the source cannot be read, or the tile cannot be encoded
/// as requested.
pub fn encode_tile(
    source: &dyn TileSource,
    painter: &TilePainter,
    encoding: TileEncoding,
    side: usize,
    void: Option<Number>,
    tile: TileId,
) -> Result<Option<Vec<u8>>> {
    if source.content(tile)? == TileContent::Empty {
        return Ok(None);
    }
    let encoder = TileEncoder::new(source, painter, encoding, side, void)?;
    Ok(encoder.with_scratch(|scratch| encoder.drawn(tile, scratch))?.map(|made| made.bytes))
}

/// Encodes a JPEG file; transparent pixels are blended with white.
fn jpeg(pixels: &[[u8; 4]], side: usize, quality: u8) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    let encoder = jpeg_encoder::Encoder::new(&mut out, quality);
    encoder.encode_image(OpaqueImage { pixels, side }).map_err(|error| error.to_string())?;
    Ok(out)
}

/// Pixels blended with white. (The image types of the JPEG crate would have its encoder compiled
/// for each colour type.)
struct OpaqueImage<'a> {
    pixels: &'a [[u8; 4]],
    side: usize,
}

impl jpeg_encoder::ImageBuffer for OpaqueImage<'_> {
    fn get_jpeg_color_type(&self) -> jpeg_encoder::JpegColorType {
        jpeg_encoder::JpegColorType::Ycbcr
    }

    fn width(&self) -> u16 {
        self.side as u16
    }

    fn height(&self) -> u16 {
        self.side as u16
    }

    fn fill_buffers(&self, y: u16, buffers: &mut [Vec<u8>; 4]) {
        let before_white = |sample: u8, opacity: u8| {
            let (sample, opacity) = (u32::from(sample), u32::from(opacity));
            ((sample * opacity + 255 * (255 - opacity) + 127) / 255) as u8
        };
        for [red, green, blue, opacity] in &self.pixels[usize::from(y) * self.side..][..self.side] {
            let [red, green, blue] = [red, green, blue].map(|sample| before_white(*sample, *opacity));
            let (luma, blueness, redness) = jpeg_encoder::rgb_to_ycbcr(red, green, blue);
            buffers[0].push(luma);
            buffers[1].push(blueness);
            buffers[2].push(redness);
        }
    }
}

/// Encodes a WebP file, lossless unless a quality is given.
fn webp(pixels: &[[u8; 4]], side: usize, quality: Option<u8>) -> Result<Vec<u8>, String> {
    #[cfg(feature = "libwebp")]
    if let Some(quality) = quality {
        let encoder = webp::Encoder::from_rgba(pixels.as_flattened(), side as u32, side as u32);
        return Ok(encoder.encode(f32::from(quality)).to_vec());
    }
    let _ = quality;
    let mut out = Vec::new();
    let encoder = image::codecs::webp::WebPEncoder::new_lossless(&mut out);
    let side = side as u32;
    let is_opaque = pixels.iter().all(|pixel| pixel[3] == 255);
    let encoded = if is_opaque {
        let rgb: Vec<u8> = pixels.iter().flat_map(|[red, green, blue, _]| [*red, *green, *blue]).collect();
        encoder.encode(&rgb, side, side, image::ExtendedColorType::Rgb8)
    } else {
        encoder.encode(pixels.as_flattened(), side, side, image::ExtendedColorType::Rgba8)
    };
    encoded.map_err(|error| error.to_string())?;
    Ok(out)
}

/// The error for tiles of samples with VOID cells that have no number.
pub(super) fn no_number(value: ValueType) -> Error {
    let found = format!(
        "VOID cells in files without a mask, where every number of type {} is a value,",
        value.sample.name()
    );
    let advice = "write png or webp tiles, which have opacity, or one .tif file, which has a mask";
    Error::unsupported("tiles of samples", found, advice)
}

//! Images in memory: for each pixel, the depth up to which it shows empty space.

use super::pyramid::{Pyramid, nodes};
use super::views_file::{ImageKind, ViewDescription};
use spinney_base::space::Region;
use spinney_base::value::{Sample, SampleType, with_sample_type};
use spinney_base::{Error, Result};
use spinney_raster::import::{Pixels, Raster, RasterInfo, RasterOptions, open};

/// Depth of a pixel that sees nothing: all space along its line of sight is empty.
const NOTHING: f32 = f32::INFINITY;
/// Depth of a pixel that shows no space to be empty: the inside of a silhouette.
const ANYTHING: f32 = f32::NEG_INFINITY;

/// Node flag: contains a pixel inside a silhouette.
const INSIDE: u8 = 1;
/// Node flag: contains a pixel outside a silhouette.
const OUTSIDE: u8 = 2;

/// An image. Depths are in units of samples: see [`View`](super::view::View).
pub(super) struct ViewImage {
    pub(super) size: [u64; 2],
    samples: Samples,
}

enum Samples {
    /// A bit for each pixel, by rows: whether it is inside.
    Silhouette(Vec<u64>, Pyramid<u8>),
    /// Depth of each pixel, and the minimum and maximum depth of each node.
    Depths(Vec<f32>, Pyramid<[f32; 2]>),
}

fn either(a: u8, b: u8) -> u8 {
    a | b
}

fn extremes(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// Returns the flag of a silhouette pixel.
fn flag(bits: &[u64], index: u64) -> u8 {
    if bits[(index / 64) as usize] >> (index % 64) & 1 == 1 { INSIDE } else { OUTSIDE }
}

impl ViewImage {
    /// Reads a view's image. `left` is the memory that remains for images, in bytes; the image's
    /// memory is subtracted from it. A reader may use `reading` bytes.
    pub(super) fn open(view: &ViewDescription, left: &mut u64, reading: u64) -> Result<ViewImage> {
        let path = &view.image;
        let mut options = RasterOptions::new();
        options.memory = reading;
        let named = |error| match error {
            // (The system's error does not name the view.)
            Error::Io { path, doing, cause } => Error::invalid(
                format!("{}, `picture`", view.name),
                format!("{} (cannot {doing}: {cause})", path.display()),
                "an image, by its path relative to the views file",
            ),
            other => other,
        };
        let mut raster = open(path, &options).map_err(named)?;
        let info = raster.info().clone();
        let size = [info.width, info.height];
        let pixels = info.width.saturating_mul(info.height);
        if pixels == 0 {
            let found = format!("an image without pixels ({})", view.name);
            return Err(Error::unsupported(path, found, "remove the view"));
        }
        let needed = match view.kind {
            ImageKind::Silhouette => (pixels / 8).saturating_add(8 + nodes(size)),
            ImageKind::Depth => pixels.saturating_add(nodes(size).saturating_mul(2)).saturating_mul(4),
        };
        if needed > *left {
            return Err(Error::TooLarge {
                path: path.clone(),
                what: format!("the image of {} ({} x {} pixels)", view.name, info.width, info.height),
                needed,
                limit: *left,
                advice: "allow more with --memory (the images of all views may take half of it)".into(),
            });
        }
        *left -= needed;
        let samples = match view.kind {
            ImageKind::Silhouette => {
                let mut bits = vec![0u64; pixels.div_ceil(64) as usize];
                let mut index = 0;
                read(&mut *raster, &info, reading, &mut |pixel, is_valid| {
                    let is_inside = is_valid && is_inside(pixel, &info, view.nodata);
                    bits[index / 64] |= u64::from(is_inside) << (index % 64);
                    index += 1;
                })?;
                let nodes = Pyramid::new(size, &|x, y| flag(&bits, y * size[0] + x), &either);
                Samples::Silhouette(bits, nodes)
            }
            ImageKind::Depth => {
                let channel = depth_channel(view, &info)?;
                let nodata = view.nodata.or(info.nodata.map(|number| number.to_f64()));
                let mut depths = Vec::with_capacity(pixels as usize);
                read(&mut *raster, &info, reading, &mut |pixel, is_valid| {
                    let number = pixel.sample(channel);
                    let is_seen =
                        is_valid && pixel.is_opaque(&info) && number.is_finite() && Some(number) != nodata;
                    // (If the scale is negative, depths count towards the viewer, and nearer points
                    // have larger samples.)
                    let depth = (number * view.scale.signum()) as f32;
                    depths.push(if is_seen && depth.is_finite() { depth } else { NOTHING });
                })?;
                let pair = |x, y| [depths[(y * size[0] + x) as usize]; 2];
                let nodes = Pyramid::new(size, &pair, &extremes);
                Samples::Depths(depths, nodes)
            }
        };
        Ok(ViewImage { size, samples })
    }

    pub(super) fn is_silhouette(&self) -> bool {
        matches!(self.samples, Samples::Silhouette(..))
    }

    /// Returns the depth up to which a pixel shows empty space.
    pub(super) fn depth(&self, [column, row]: [u64; 2]) -> f32 {
        let index = row * self.size[0] + column;
        match &self.samples {
            Samples::Silhouette(bits, _) => match flag(bits, index) {
                INSIDE => ANYTHING,
                _ => NOTHING,
            },
            Samples::Depths(depths, _) => depths[index as usize],
        }
    }

    /// Returns bounds of the depths of the pixels in a rectangle, from its first column and row to
    /// its last.
    pub(super) fn depths(&self, rectangle: [[u64; 2]; 2]) -> [f32; 2] {
        let columns = self.size[0];
        match &self.samples {
            Samples::Silhouette(bits, nodes) => {
                let flags = nodes.within(rectangle, &|x, y| flag(bits, y * columns + x), &either);
                [
                    if flags & INSIDE != 0 { ANYTHING } else { NOTHING },
                    if flags & OUTSIDE != 0 { NOTHING } else { ANYTHING },
                ]
            }
            Samples::Depths(depths, nodes) => {
                let pair = |x, y| [depths[(y * columns + x) as usize]; 2];
                nodes.within(rectangle, &pair, &extremes)
            }
        }
    }
}

/// A pixel's samples.
struct Pixel<'a> {
    bytes: &'a [u8],
    sample: SampleType,
}

impl Pixel<'_> {
    fn sample(&self, channel: usize) -> f64 {
        let bytes = &self.bytes[channel * self.sample.size()..];
        with_sample_type!(self.sample, S => S::read(bytes).to_f64())
    }

    fn is_opaque(&self, info: &RasterInfo) -> bool {
        info.alpha.is_none_or(|alpha| self.sample(alpha) > 0.0)
    }
}

/// Whether a silhouette pixel is inside: if it is not transparent or, without an alpha channel, if
/// any sample is neither zero nor nodata.
fn is_inside(pixel: Pixel<'_>, info: &RasterInfo, nodata: Option<f64>) -> bool {
    if info.alpha.is_some() {
        return pixel.is_opaque(info);
    }
    let nodata = nodata.or(info.nodata.map(|number| number.to_f64()));
    let is_empty = |number: f64| number == 0.0 || number.is_nan() || Some(number) == nodata;
    (0..info.channels).any(|channel| !is_empty(pixel.sample(channel)))
}

/// Returns the channel that contains the depths.
fn depth_channel(view: &ViewDescription, info: &RasterInfo) -> Result<usize> {
    let mut channels = (0..info.channels).filter(|channel| Some(*channel) != info.alpha);
    match (channels.next(), channels.next()) {
        (Some(channel), None) => Ok(channel),
        _ => {
            let found = format!("a depth image with {} channels ({})", info.channels, view.name);
            Err(Error::unsupported(&view.image, found, "a depth is one number: keep one channel"))
        }
    }
}

/// Yields all pixels by rows, with whether each is valid according to the image's mask.
fn read(
    raster: &mut dyn Raster,
    info: &RasterInfo,
    memory: u64,
    take: &mut dyn FnMut(Pixel<'_>, bool),
) -> Result<()> {
    let width = info.sample.size() * info.channels;
    let rows = (memory / 2 / info.width.saturating_mul(width as u64).max(1)).clamp(1, 256);
    let mut pixels = Pixels::default();
    for row in (0..info.height).step_by(rows as usize) {
        raster.read(Region::new(0, row, info.width, rows.min(info.height - row)), &mut pixels)?;
        for (number, bytes) in pixels.bytes.chunks_exact(width).enumerate() {
            let is_valid = pixels.valid.as_ref().is_none_or(|valid| valid[number]);
            take(Pixel { bytes, sample: info.sample }, is_valid);
        }
    }
    Ok(())
}

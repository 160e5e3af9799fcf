//! GDAL's virtual rasters (VRT): XML files that compose a raster from regions of other files.

mod parse;

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::ahead::{MappedRaster, PixelMapping, prefetch_mapped};
use super::lazy::Lazy;
use super::{Order, Pixels, Raster, RasterInfo, RasterOptions, SourceWindows};
use crate::index::SourceWindow;
use spinney_base::space::Region;
use spinney_base::value::{SampleType, ValueType};
use spinney_base::{Error, Result};
use spinney_container::shell_word;
use spinney_references::PixelRule;

/// Maximum nesting of virtual rasters.
const MAX_NESTED: u8 = 4;
/// Maximum number of sources of a virtual raster, including those of nested virtual rasters for
/// each use.
const MAX_SOURCES: u64 = 1 << 20;

/// Nesting level and source budget of a file among nested virtual rasters.
#[derive(Clone, Debug)]
pub(crate) struct Nesting {
    depth: u8,
    /// Remaining number of sources, shared by all of them.
    left: Arc<AtomicU64>,
}

impl Default for Nesting {
    fn default() -> Nesting {
        Nesting { depth: 0, left: Arc::new(AtomicU64::new(MAX_SOURCES)) }
    }
}

impl Nesting {
    /// The nesting of a source, with the same source budget.
    fn inside(&self, path: &Path) -> Result<Nesting> {
        let depth = self.depth + 1;
        if depth > MAX_NESTED {
            let found = format!("a virtual raster that is nested more than {MAX_NESTED} deep, or in itself,");
            return Err(unsupported(path, found));
        }
        Ok(Nesting { depth, left: Arc::clone(&self.left) })
    }

    /// Returns this nesting level with a fresh source budget.
    pub(super) fn with_fresh_budget(&self) -> Nesting {
        Nesting { depth: self.depth, ..Nesting::default() }
    }

    fn left(&self) -> u64 {
        self.left.load(Ordering::Relaxed)
    }

    /// Deducts sources from the budget.
    fn spend(&self, path: &Path, sources: u64) -> Result<()> {
        let left = self.left().checked_sub(sources).ok_or_else(|| {
            let found =
                format!("a virtual raster of more than {MAX_SOURCES} sources, including nested ones,");
            unsupported(path, found)
        })?;
        self.left.store(left, Ordering::Relaxed);
        Ok(())
    }
}

/// The error for an unsupported feature of virtual rasters.
fn unsupported(path: &Path, found: impl Into<String>) -> Error {
    let advice = format!("convert it to GeoTIFF first (`gdal_translate {} OUT.tif`)", shell_word(path));
    Error::unsupported(path, found, advice)
}

/// Whether a file with these first bytes is a virtual raster.
pub(super) fn is_vrt(start: &[u8]) -> bool {
    let text = String::from_utf8_lossy(start);
    let text = text.trim_start_matches('\u{feff}').trim_start();
    text.starts_with("<VRTDataset") || text.starts_with("<?xml") && text.contains("<VRTDataset")
}

/// Opens a virtual raster and reads the headers of its sources.
pub(super) fn open(path: &Path, options: &RasterOptions) -> Result<Box<dyn Raster>> {
    parse::read(path, options).map(|vrt| Box::new(vrt) as _)
}

/// The files of a virtual raster's sources, each once, and the options to open them.
pub(super) fn sources(path: &Path, options: &RasterOptions) -> Result<Vec<(PathBuf, RasterOptions)>> {
    let vrt = parse::read(path, options)?;
    let mut known = HashSet::new();
    let all = vrt.bands.iter().flat_map(|band| &band.sources).map(|source| source.raster.opened_as());
    let once = all.filter(|(path, _)| known.insert(path.to_path_buf()));
    Ok(once.map(|(path, options)| (path.to_path_buf(), options)).collect())
}

/// A virtual raster.
struct Vrt {
    path: PathBuf,
    /// The selected bands.
    bands: Vec<Band>,
    info: RasterInfo,
    part: Pixels,
    plane: Plane,
}

/// A band composed of regions of other rasters.
struct Band {
    sample: SampleType,
    /// The sample where no source has one.
    hole: Vec<u8>,
    /// Ordered from bottom to top.
    sources: Vec<Source>,
}

/// A region of one channel of another raster.
struct Source {
    raster: Lazy,
    /// The pixels of the band that this source covers.
    region: Region,
    mapping: PixelMapping,
    missing: Missing,
}

/// Samples of a source that are transparent.
#[derive(Clone)]
enum Missing {
    None,
    Sample(Vec<u8>),
    Nan,
}

impl Missing {
    fn is(&self, sample: &[u8]) -> bool {
        match self {
            Missing::None => false,
            Missing::Sample(missing) => missing == sample,
            Missing::Nan => match *sample {
                [a, b, c, d] => f32::from_le_bytes([a, b, c, d]).is_nan(),
                [a, b, c, d, e, f, g, h] => f64::from_le_bytes([a, b, c, d, e, f, g, h]).is_nan(),
                _ => false,
            },
        }
    }
}

/// Samples of a region of one band.
#[derive(Default)]
struct Plane {
    bytes: Vec<u8>,
    /// Whether a source covers the sample.
    covered: Vec<bool>,
    /// Number of samples that are not covered yet.
    left: usize,
}

impl Band {
    /// A copy of the band with file readers of its own.
    fn another(&self) -> Band {
        let another = |source: &Source| Source {
            raster: source.raster.another(),
            missing: source.missing.clone(),
            ..*source
        };
        Band {
            sample: self.sample,
            hole: self.hole.clone(),
            sources: self.sources.iter().map(another).collect(),
        }
    }

    /// Reads a region into a plane, from the top source down, until all of it is covered.
    fn read(&mut self, region: Region, part: &mut Pixels, plane: &mut Plane) -> Result<()> {
        let area = region.area() as usize;
        plane.bytes.clear();
        plane.bytes.extend(self.hole.iter().copied().cycle().take(area * self.hole.len()));
        plane.covered.clear();
        plane.covered.resize(area, false);
        plane.left = area;
        for source in self.sources.iter_mut().rev() {
            if plane.left == 0 {
                break;
            }
            let wanted = source.region.intersect(&region);
            if !wanted.is_empty() {
                let from = source.read(wanted, part)?;
                let sample = source.raster.info().sample;
                source.paint(part, sample, from, wanted, plane, self.sample, region);
            }
        }
        Ok(())
    }
}

impl Source {
    fn mapped(&mut self) -> MappedRaster<'_> {
        MappedRaster { raster: &mut self.raster, covers: self.region, mapping: self.mapping }
    }

    /// Reads the samples for some pixels of the band; returns their region in the other raster.
    fn read(&mut self, wanted: Region, part: &mut Pixels) -> Result<Region> {
        let from = self.mapping.own_region(wanted);
        self.raster.read(from, part)?;
        Ok(from)
    }

    /// Copies samples to pixels that are not covered yet.
    #[expect(
        clippy::too_many_arguments,
        reason = "regions of both rasters and of the plane, with their types"
    )]
    fn paint(
        &self,
        part: &Pixels,
        sample: SampleType,
        from: Region,
        wanted: Region,
        plane: &mut Plane,
        to: SampleType,
        region: Region,
    ) {
        let (size, wide) = (sample.size(), to.size());
        let PixelMapping { origin, factor } = self.mapping;
        let mut widened = Vec::new();
        for y in wanted.y..wanted.bottom() {
            let row = (y as i64 - origin[1]) as u64 / factor[1] - from.y;
            let row = &part.bytes[(row * from.width) as usize * size..][..from.width as usize * size];
            let start = ((y - region.y) * region.width + wanted.x - region.x) as usize;
            let range = start..start + wanted.width as usize;
            let covered = &mut plane.covered[range.clone()];
            let target = &mut plane.bytes[range.start * wide..range.end * wide];
            let samples = if sample == to {
                row
            } else {
                widen(row, sample, to, &mut widened);
                &widened
            };
            if factor[0] == 1 && matches!(self.missing, Missing::None) && !covered.contains(&true) {
                target.copy_from_slice(samples);
                covered.fill(true);
                plane.left -= covered.len();
                continue;
            }
            let first = (wanted.x as i64 - origin[0]) as u64;
            for ((x, covered), target) in (first..).zip(covered).zip(target.chunks_exact_mut(wide)) {
                let column = (x / factor[0] - from.x) as usize;
                if !*covered && !self.missing.is(&row[column * size..][..size]) {
                    target.copy_from_slice(&samples[column * wide..][..wide]);
                    *covered = true;
                    plane.left -= 1;
                }
            }
        }
    }
}

/// Converts samples to a wider type.
fn widen(bytes: &[u8], from: SampleType, to: SampleType, out: &mut Vec<u8>) {
    let mut numbers = Vec::new();
    ValueType::new(from, 1).push_numbers(0, bytes, &mut numbers);
    out.clear();
    for number in numbers {
        let sample = ValueType::new(to, 1).nearest(|_| number).to_bytes();
        out.extend_from_slice(&sample[..to.size()]);
    }
}

impl Raster for Vrt {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.info.check(region)?;
        let (area, size) = (region.area() as usize, self.info.sample.size());
        let channels = self.bands.len();
        pixels.bytes.clear();
        pixels.bytes.resize(area * size * channels, 0);
        // A pixel that no band covers is VOID.
        let mut covered = vec![false; area];
        let mut widened = Vec::new();
        for (channel, band) in self.bands.iter_mut().enumerate() {
            band.read(region, &mut self.part, &mut self.plane)?;
            covered.iter_mut().zip(&self.plane.covered).for_each(|(any, here)| *any |= here);
            if band.sample != self.info.sample {
                widen(&self.plane.bytes, band.sample, self.info.sample, &mut widened);
                std::mem::swap(&mut widened, &mut self.plane.bytes);
            }
            if channels == 1 {
                std::mem::swap(&mut pixels.bytes, &mut self.plane.bytes);
                continue;
            }
            let targets = pixels.bytes.chunks_exact_mut(size).skip(channel).step_by(channels);
            for (sample, target) in self.plane.bytes.chunks_exact(size).zip(targets) {
                target.copy_from_slice(sample);
            }
        }
        pixels.valid = covered.contains(&false).then_some(covered);
        Ok(())
    }

    fn choose(&mut self, channels: &[usize]) -> bool {
        // A band selected twice would need its sources twice.
        let twice = (1..channels.len()).any(|at| channels[..at].contains(&channels[at]));
        if twice {
            return false;
        }
        let mut bands: Vec<Option<Band>> = std::mem::take(&mut self.bands).into_iter().map(Some).collect();
        self.bands = channels.iter().filter_map(|channel| bands[*channel].take()).collect();
        self.info = self.info.of_channels(channels);
        self.info.order = order(&self.bands);
        true
    }

    fn separate_channels(&self, channels: &[usize]) -> Option<Box<dyn Raster>> {
        let bands: Vec<Band> = channels.iter().map(|channel| self.bands[*channel].another()).collect();
        let info = RasterInfo { order: order(&bands), ..self.info.of_channels(channels) };
        let (part, plane) = (Pixels::default(), Plane::default());
        Some(Box::new(Vrt { path: self.path.clone(), bands, info, part, plane }))
    }

    fn has_separate_channels(&self) -> bool {
        true
    }

    fn reads_anywhere(&self) -> bool {
        true
    }

    fn prefetch(&mut self, regions: &[Region]) -> Result<usize> {
        let sources = self.bands.iter_mut().flat_map(|band| &mut band.sources);
        prefetch_mapped(regions, sources.map(Source::mapped).collect())
    }

    fn source_windows(&self) -> SourceWindows {
        let Some((first, others)) = self.bands.split_first() else { return Ok(Vec::new()) };
        // Every band has the same windows of the same files.
        let are_alike = |band: &Band| band.sources.len() == first.sources.len();
        if !others.iter().all(are_alike) || self.bands.iter().any(|band| band.sample != self.info.sample) {
            return Err(OTHER_BANDS.into());
        }
        let window = |number: usize| {
            let mut window = first.sources[number].window(self.info.sample)?;
            for band in others {
                let other = band.sources[number].window(self.info.sample)?;
                let is_alike = (other.source, other.cells, other.from)
                    == (window.source, window.cells, window.from)
                    && other.rule == window.rule;
                if !is_alike {
                    return Err(OTHER_BANDS.into());
                }
                if window.rule.nodata.is_some() || window.rule.nan {
                    return Err(
                        "a virtual raster of several bands with nodata, whose VOID pixels differ".into()
                    );
                }
                window.channels.extend(other.channels);
            }
            Ok(window)
        };
        (0..first.sources.len()).map(window).collect()
    }
}

/// Description of bands that are not those of a file, for messages.
const OTHER_BANDS: &str = "a virtual raster whose bands are not bands of the same files, of one type";

impl Source {
    /// Returns the window of a file that the source is, if its samples are used unchanged.
    fn window(&self, sample: SampleType) -> std::result::Result<SourceWindow, String> {
        if self.mapping.factor != [1; 2] || self.raster.info().sample != sample {
            return Err("a virtual raster that scales or converts pixels".into());
        }
        let nested = "a virtual raster of virtual rasters";
        let [window] = <[SourceWindow; 1]>::try_from(self.raster.source_windows()?).map_err(|_| nested)?;
        if window.rule != PixelRule::default() {
            return Err(nested.into());
        }
        let along =
            |axis: usize, start: u64| (start as i64 - self.mapping.origin[axis]) as u64 + window.from[axis];
        let from = [along(0, self.region.x), along(1, self.region.y)];
        let (nodata, nan) = match &self.missing {
            Missing::None => (None, false),
            Missing::Sample(sample) => (Some(sample.clone()), false),
            Missing::Nan => (None, true),
        };
        let rule = PixelRule { nodata, nan, ignores_mask: true, ..PixelRule::default() };
        Ok(SourceWindow { rule, cells: self.region, from, ..window })
    }
}

/// The read order that is cheap for all sources.
fn order(bands: &[Band]) -> Order {
    let mut sources = bands.iter().flat_map(|band| &band.sources);
    if sources.any(|source| source.raster.info().order == Order::Bands) {
        Order::Bands
    } else {
        Order::Anywhere
    }
}

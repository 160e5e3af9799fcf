//! Adapters that derive the raster of a layer from another raster.

use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::super::validity::Validity;
use super::super::{Pixels, Raster, RasterInfo, SourceWindows, Transparent};
use crate::index::SourceWindow;
use spinney_base::Result;
use spinney_base::space::{Bounds, Region};
use spinney_base::value::Number;
use spinney_engine::dataset::Dataset;
use spinney_references::PixelRule;

/// A raster without its last channel, whose zeros make it VOID.
pub(super) struct Masked {
    raster: Box<dyn Raster>,
    opacity: Validity,
    info: RasterInfo,
    all: Pixels,
}

impl Masked {
    pub(super) fn new(raster: Box<dyn Raster>) -> Masked {
        let last = raster.info().channels - 1;
        let all = RasterInfo { alpha: Some(last), transparent: Transparent::Void, ..raster.info().clone() };
        let rest: Vec<usize> = (0..last).collect();
        let info = RasterInfo { alpha: None, sample: all.sample, ..all.of_channels(&rest) };
        Masked { raster, opacity: Validity::by_opacity(&all), info, all: Pixels::default() }
    }
}

impl Raster for Masked {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        self.raster.path()
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.raster.read(region, &mut self.all)?;
        self.opacity.apply(&mut self.all);
        let (kept, all) = (self.info.pixel_bytes(), self.raster.info().pixel_bytes());
        pixels.bytes.clear();
        pixels.bytes.extend(self.all.bytes.chunks_exact(all).flat_map(|pixel| &pixel[..kept]));
        pixels.valid = self.all.valid.take();
        Ok(())
    }

    fn reads_anywhere(&self) -> bool {
        self.raster.reads_anywhere()
    }

    fn source_windows(&self) -> SourceWindows {
        let windows = self.raster.source_windows()?.into_iter().map(|mut window| {
            // The last channel is the opacity that `StackLayer::channels` appends.
            let opacity = window.channels.pop().and_then(|channel| u16::try_from(channel).ok());
            let is_plain = window.rule == PixelRule::default() && opacity.is_some();
            window.rule.hidden_opacity = opacity;
            is_plain.then_some(window).ok_or_else(|| "a virtual raster with opacity".to_string())
        });
        windows.collect()
    }
}

/// The cells of a tree in a temporary directory.
pub(super) struct TreeRaster {
    tree: Dataset,
    info: RasterInfo,
    /// The file that the tree was made from.
    path: PathBuf,
    fill: Number,
    // Dropped last, when no file in it is open.
    _directory: TempDir,
}

impl TreeRaster {
    pub(super) fn new(tree: Dataset, directory: TempDir, path: &Path, nodata: Option<Number>) -> TreeRaster {
        let header = tree.header();
        let ([width, height, _], value) = (header.extent, header.form.value);
        let info = RasterInfo::plain([width, height], value.sample, usize::from(value.channels));
        TreeRaster { info, path: path.into(), fill: nodata.unwrap_or_default(), tree, _directory: directory }
    }
}

impl Raster for TreeRaster {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.info.check(region)?;
        let bounds = Bounds { min: [region.x, region.y, 0], max: [region.right(), region.bottom(), 1] };
        pixels.bytes.resize(region.area() as usize * self.info.pixel_bytes(), 0);
        let mut valid = vec![false; region.area() as usize];
        self.tree.window(self.tree.depth(), &bounds, self.fill, &mut pixels.bytes, Some(&mut valid))?;
        pixels.valid = valid.contains(&false).then_some(valid);
        Ok(())
    }
}

/// A raster with repeated pixels.
pub(super) struct Repeated {
    raster: Box<dyn Raster>,
    times: u64,
    info: RasterInfo,
    part: Pixels,
}

impl Repeated {
    /// Repeats the pixels of a randomly accessible raster `times` times along each axis.
    pub(super) fn new(raster: Box<dyn Raster>, times: u64) -> Repeated {
        let mut info = raster.info().clone();
        (info.width, info.height) = (info.width * times, info.height * times);
        Repeated { raster, times, info, part: Pixels::default() }
    }
}

impl Raster for Repeated {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        self.raster.path()
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.info.check(region)?;
        let times = self.times;
        let (x, y) = (region.x / times, region.y / times);
        let (right, bottom) = (region.right().div_ceil(times), region.bottom().div_ceil(times));
        let from = Region::new(x, y, right - x, bottom - y);
        self.raster.read(from, &mut self.part)?;
        let size = self.info.pixel_bytes();
        pixels.bytes.clear();
        pixels.bytes.reserve_exact(region.area() as usize * size);
        let mut flags = self.part.valid.as_ref().map(|_| Vec::with_capacity(region.area() as usize));
        for row in region.y..region.bottom() {
            let start = ((row / times - y) * from.width) as usize;
            for column in region.x..region.right() {
                let at = start + (column / times - x) as usize;
                pixels.bytes.extend_from_slice(&self.part.bytes[at * size..][..size]);
                if let (Some(flags), Some(valid)) = (&mut flags, &self.part.valid) {
                    flags.push(valid[at]);
                }
            }
        }
        pixels.valid = flags;
        Ok(())
    }
}

/// A raster with VOID to its left and above it.
pub(super) struct Padded {
    raster: Box<dyn Raster>,
    offset: [u64; 2],
    info: RasterInfo,
    part: Pixels,
}

impl Padded {
    /// A raster that begins at a column and row.
    pub(super) fn new(raster: Box<dyn Raster>, offset: [u64; 2]) -> Padded {
        let mut info = raster.info().clone();
        (info.width, info.height) = (info.width + offset[0], info.height + offset[1]);
        Padded { raster, offset, info, part: Pixels::default() }
    }
}

impl Raster for Padded {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        self.raster.path()
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.info.check(region)?;
        let [left, top] = self.offset;
        let (x, y) = (region.x.max(left), region.y.max(top));
        let (width, height) = (region.right().saturating_sub(x), region.bottom().saturating_sub(y));
        let size = self.info.pixel_bytes();
        pixels.bytes.clear();
        pixels.bytes.resize(region.area() as usize * size, 0);
        let mut flags = vec![false; region.area() as usize];
        if width > 0 && height > 0 {
            self.raster.read(Region::new(x - left, y - top, width, height), &mut self.part)?;
            for row in 0..height {
                let from = (row * width) as usize..((row + 1) * width) as usize;
                let to = ((y - region.y + row) * region.width + x - region.x) as usize;
                pixels.bytes[to * size..][..from.len() * size]
                    .copy_from_slice(&self.part.bytes[from.start * size..from.end * size]);
                match &self.part.valid {
                    Some(valid) => flags[to..][..from.len()].copy_from_slice(&valid[from]),
                    None => flags[to..][..from.len()].fill(true),
                }
            }
        }
        pixels.valid = flags.contains(&false).then_some(flags);
        Ok(())
    }

    fn reads_anywhere(&self) -> bool {
        self.raster.reads_anywhere()
    }

    fn source_windows(&self) -> SourceWindows {
        let moved = |window: SourceWindow| {
            let Region { x, y, width, height } = window.cells;
            let cells = Region::new(x + self.offset[0], y + self.offset[1], width, height);
            SourceWindow { cells, ..window }
        };
        Ok(self.raster.source_windows()?.into_iter().map(moved).collect())
    }
}

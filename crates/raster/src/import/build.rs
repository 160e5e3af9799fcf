//! Building of an import's tree.

use std::path::Path;
use std::sync::Arc;

use super::plan::RasterImport;
use super::slabs::BLOCK;
use super::spill::spill_wanted;
use super::{Order, Raster, RasterInfo, RasterSlabs};
use crate::index::write_sections;

use spinney_base::TreeType;
use spinney_base::io::{Output, directory_of};
use spinney_base::space::Dimension;
use spinney_base::{Error, Progress, Result, SubProgress};
use spinney_container::check_tree_name;
use spinney_engine::ops::{Resampling, TreeFile, WarpGrid, WarpOptions, Warped, grid_like, warp};
use spinney_engine::store::{Packing, TreeWriter, WantedCells, depth_for};

impl RasterImport {
    /// Builds the tree on the threads of the current rayon pool; progress counts pixels.
    ///
    /// An image that can only be read from the top down is first copied to a temporary file in the
    /// output's directory, if its rows exceed the memory.
    ///
    /// # Errors
    /// If the input cannot be read, the output cannot be written, or on cancellation. Nothing is
    /// left then.
    pub fn build(mut self, output: Output, progress: &dyn Progress) -> Result<()> {
        check_tree_name(output.path())?;
        self.options.packing.check_output(output.path())?;
        let scratch_directory = directory_of(output.path()).to_path_buf();
        let path = output.path().to_path_buf();
        let mut file = TreeWriter::create(output, (Dimension::Quad, self.options.depth), 1)?;
        let index = self.index.take();
        self.write(&mut file, &scratch_directory, progress)?;
        if let Some(index) = index {
            let (sources, pages) = write_sections(&path, &[&index], progress)?;
            file.set_references(sources, pages);
        }
        file.finish()
    }

    /// Writes the tree, or the requested range of it, as the next layer of a file. Temporary files
    /// are created in the directory `scratch_directory`.
    ///
    /// # Errors
    /// Those of [`RasterImport::build`].
    pub fn write(
        self,
        file: &mut TreeWriter,
        scratch_directory: &Path,
        progress: &dyn Progress,
    ) -> Result<()> {
        self.remarks.iter().for_each(|(path, remark)| progress.warn(path, remark));
        let form = TreeType::new(Dimension::Quad, self.value);
        if file.run().is_none() {
            let RasterInfo { width, height, .. } = self.raster.info();
            return file.write_layer_header(form, [*width, *height, 1], &self.options);
        }
        let half = self.memory / 2;
        let (size, budget, depth) =
            (self.value.size(), MemoryBudget { bands: half, slabs: half / 2 }, self.options.depth);
        let mut slabs = slabs_for(
            RequestedCells::by(file, depth),
            self.raster,
            size,
            (scratch_directory, budget),
            progress,
        )?;
        let nodata = self.nodata.and_then(|number| self.value.splat(number));
        file.slabs(form, &mut slabs, nodata, &self.options, progress)
    }

    /// Builds the tree on another grid. The tree on the image's own grid is first built in a
    /// temporary file in the output's directory, so that it can be read in any order.
    ///
    /// # Errors
    /// Those of [`RasterImport::build`]; also if the image has no coordinate system or it is not
    /// supported.
    pub fn build_warped(
        mut self,
        target: &TargetGrid,
        options: &WarpOptions,
        output: Output,
        progress: &dyn Progress,
    ) -> Result<WarpedBuilt> {
        let info = self.raster.info();
        let (cells, extent) = (info.width * info.height, [info.width, info.height, 1]);
        let how = self.options.clone().memory(self.memory / 4);
        // Fail early if there is no such grid.
        check_tree_name(output.path())?;
        let frame = self.options.metadata.frame.clone();
        let grid = match target {
            TargetGrid::WebMercator(zoom) => {
                WarpGrid::web_mercator(*zoom, &frame, extent, options.allow_ballpark)
                    .map_err(|error| error.of_file(self.raster.path()))?
            }
            TargetGrid::Cells(grid) => (**grid).clone(),
            TargetGrid::Like(grid) => {
                let own = WarpGrid { frame: frame.clone(), extent };
                let name = self.raster.path().display().to_string();
                grid_like(("the grid", grid), (&name, &own), options.allow_ballpark)?
            }
        };
        let near = directory_of(output.path());
        let temporary = tempfile::Builder::new().prefix(".spinney-").tempdir_in(near);
        let temporary = temporary.map_err(Error::io(near, "create a temporary directory in it"))?;
        let native = temporary.path().join("native.goblin");
        // The temporary tree is neither packed nor rounded.
        (self.options.share, self.options.packing) = (false, Packing::default());
        let access = output.access().clone();
        self.build(access.create(&native)?, &SubProgress::new(progress, cells, 2 * cells))?;
        let file = TreeFile::open(&native, &access.into())?;
        let warped = Warped::new(Arc::new(file.into()), &frame, &grid, options)?;
        let resampling = warped.resampling();
        warp(warped, &how, output, &SubProgress::new(progress, cells, 2 * cells))?;
        Ok(WarpedBuilt { depth: depth_for(grid.extent), resampling })
    }
}

/// Memory budget in bytes for reading a raster: for bands of rows, if it is read in these, and for
/// slabs.
#[derive(Clone, Copy)]
pub(super) struct MemoryBudget {
    pub(super) bands: u64,
    pub(super) slabs: u64,
}

/// Cells of a raster that a file requests.
#[derive(Clone, Copy)]
pub(super) enum RequestedCells {
    /// None: only properties of the raster are needed.
    Nothing,
    /// All, in any order.
    All,
    /// The cells of a run, in FD order.
    Range(WantedCells),
}

impl RequestedCells {
    /// The cells that a file requests for its next layer, whose tree has this depth.
    pub(super) fn by(file: &TreeWriter, depth: u8) -> RequestedCells {
        match file.run() {
            None => RequestedCells::Nothing,
            Some(run) if file.needs_order() => {
                RequestedCells::Range(WantedCells { dimension: Dimension::Quad, depth, run })
            }
            Some(_) => RequestedCells::All,
        }
    }
}

/// Yields the requested cells of a raster with values of `value_size` bytes. A raster that can only
/// be read from the top down is first copied to a temporary file in a directory, if it takes too
/// much memory or another order is requested.
pub(super) fn slabs_for(
    requested: RequestedCells,
    raster: Box<dyn Raster>,
    value_size: usize,
    (directory, budget): (&Path, MemoryBudget),
    progress: &dyn Progress,
) -> Result<RasterSlabs> {
    let wanted = match requested {
        RequestedCells::Nothing => return Ok(RasterSlabs::new(raster, budget.slabs)),
        RequestedCells::All => None,
        RequestedCells::Range(wanted) => Some(wanted),
    };
    let in_bands = raster.info().order == Order::Bands;
    let is_spilled = in_bands && (wanted.is_some() || bands_memory(raster.info(), value_size) > budget.bands);
    let raster = match is_spilled {
        true => spill_wanted(raster, wanted, directory, budget.slabs, progress)?,
        false => raster,
    };
    let slabs = RasterSlabs::new(raster, budget.slabs);
    Ok(match wanted {
        Some(wanted) => slabs.within(wanted),
        None => slabs,
    })
}

/// A grid that images are warped to.
#[derive(Clone, Debug)]
pub enum TargetGrid {
    /// The grid of web maps, down to the tiles of a zoom: see [`WarpGrid::web_mercator`].
    WebMercator(Option<u8>),
    /// Any other grid.
    Cells(Box<WarpGrid>),
    /// The cells of another tree, over the union of its extent and the raster's.
    Like(Box<WarpGrid>),
}

/// Properties of a tree that was built on another grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WarpedBuilt {
    /// Depth of the tree.
    pub depth: u8,
    /// Resampling method.
    pub resampling: Resampling,
}

/// Bytes that building from bands of rows takes: two bands, and the subtrees along the width that
/// wait for the rows below them.
///
/// At most 4096 records wait per block. One row of blocks waits at the lowest level, two merged
/// rows at the next level, and so on. Above the second level segments have been cut off, so each
/// further level has a quarter of the records. Together that is at most four rows of blocks.
pub(super) fn bands_memory(info: &RasterInfo, value_size: usize) -> u64 {
    const WAITING: u64 = 4 * 4096;
    // Four values, their states and a link.
    let record = 4 * value_size as u64 + 4;
    let band = info.width * BLOCK * (info.pixel_bytes() as u64 + 1);
    2 * band + info.width.div_ceil(BLOCK) * WAITING * record
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::fake::Fake;
    use super::super::{DEFAULT_MEMORY, spill};
    use super::*;
    use spinney_base::value::{DataKind, SampleType, ValueType};
    use spinney_engine::store::{BuildOptions, build_slabs};

    fn bytes_of(raster: Box<dyn Raster>, memory: u64, path: &Path) -> Vec<u8> {
        let options = BuildOptions::new(DataKind::Continuous, 11).memory(memory);
        let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
        let output = Output::create(path).unwrap();
        build_slabs(form, &mut RasterSlabs::new(raster, memory), None, &options, output, &()).unwrap();
        std::fs::read(path).unwrap()
    }

    #[test]
    fn spilling_and_memory_do_not_change_the_bytes() {
        let (width, height) = (1500, 1100);
        let fake = |order| -> Box<dyn Raster> {
            let info = RasterInfo { order, ..RasterInfo::plain([width, height], SampleType::U8, 1) };
            let pixel = |i: u64| ((i % width) * (i / width) / 900) as u8;
            Box::new(Fake::new(info, (0..width * height).map(pixel).collect()))
        };
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("t.goblin");
        let direct = bytes_of(fake(Order::Anywhere), 64 << 20, &path);
        for memory in [0, 1 << 20, 64 << 20] {
            let spilled = spill(fake(Order::Bands), directory.path(), memory, &()).unwrap();
            assert!(bytes_of(spilled, memory, &path) == direct, "{memory}");
        }
    }

    #[test]
    fn wide_rasters_need_more_memory_than_narrow_ones() {
        let needed = |width| bands_memory(&RasterInfo::plain([width, 10], SampleType::U8, 1), 1);
        assert_eq!(needed(256), 2 * 256 * 256 * 2 + 4 * 4096 * 8);
        assert!(needed(43200) < DEFAULT_MEMORY / 2 && needed(1 << 20) > DEFAULT_MEMORY / 2);
    }
}

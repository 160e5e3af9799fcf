//! The pixel grid of an output, in cells of the level that the pixels are made of.

use super::span::Span;
use super::{Detail, WindowRequest};
use spinney_base::space::Bounds;
use spinney_base::value::{DataKind, Rule, ValueType};
use spinney_base::{Error, Result};
use spinney_engine::dataset::Dataset;

/// The pixel grid of an output, in cells of the level that the pixels are made of.
pub(crate) struct OutputGrid {
    pub(super) level: u8,
    /// Cells of the level that the pixels are made of: one layer of them.
    pub(super) source: Bounds,
    /// The axis of the tree that the output lacks, then the axes of its columns and rows.
    pub(super) across: usize,
    pub(super) axes: [usize; 2],
    pub(super) width: u64,
    pub(super) height: u64,
    /// First corner of the first pixel, and size of a pixel, along columns and rows.
    pub(super) origin: [f64; 2],
    pub(super) step: [f64; 2],
    pub(super) pixels: PixelContent,
}

/// Content of an output's pixels.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum PixelContent {
    /// One cell of the level per pixel.
    Cell,
    /// Mean of the cells of the level that the pixel covers, or the cell at its centre.
    Resampled,
    /// Exact mean of the deepest cells.
    Exact,
}

impl OutputGrid {
    /// Computes the grid of a request.
    ///
    /// # Errors
    /// If the window is empty or outside of the tree, the tree has no such level, or the output
    /// would have no pixels.
    pub(crate) fn of(tree: &Dataset, request: &WindowRequest) -> Result<OutputGrid> {
        let depth = tree.depth();
        let across = request.across;
        let axes = match across {
            0 => [1, 2],
            1 => [0, 2],
            _ => [0, 1],
        };
        let size = axes.map(|axis| request.bounds.size()[axis]);
        if request.bounds.is_empty() {
            return Err(Error::invalid(
                "window",
                format!("{} x {} cells", size[0], size[1]),
                "at least one cell",
            ));
        }
        if request.bounds.intersect(&tree.header().extent_bounds()).is_empty() {
            let [x, y, z] = request.bounds.min;
            let [width, height, depth] = tree.header().extent;
            let expected = format!("a window that intersects its {width} x {height} x {depth} cells");
            return Err(Error::invalid(
                "window",
                format!("a window outside of the tree, from cell {x},{y},{z} on"),
                expected,
            ));
        }
        let level = match request.detail {
            Detail::Level(level) if level <= depth => level,
            Detail::Level(level) => {
                return Err(Error::invalid("level", level.to_string(), format!("0 to {depth}")));
            }
            Detail::Size(width, height) | Detail::Exact(width, height) if width == 0 || height == 0 => {
                return Err(Error::invalid("size", format!("{width}x{height}"), "at least 1x1"));
            }
            Detail::Exact(..) if !is_averaged(tree) => {
                let found = "exact means of values that are not averaged";
                return Err(Error::invalid(
                    "detail",
                    found,
                    "a size, whose pixels are the cells at their centres",
                ));
            }
            Detail::Exact(..) => depth,
            Detail::Size(width, height) => {
                let first = axes.map(|axis| request.bounds.min[axis]);
                level_for(tree, (first, size), (width, height))
            }
        };
        let shift = depth - level;
        let mut source = request.bounds;
        for axis in 0..3 {
            source.min[axis] >>= shift;
            source.max[axis] = source.max[axis].div_ceil(1 << shift);
        }
        source.max[across] = source.min[across] + 1;
        let (width, height, origin, step) = match request.detail {
            Detail::Level(_) => {
                let [width, height] = axes.map(|axis| source.size()[axis]);
                (width, height, axes.map(|axis| source.min[axis] as f64), [1.0, 1.0])
            }
            // The window need not be aligned to cells of the level: its own corners are divided
            // evenly.
            Detail::Size(width, height) | Detail::Exact(width, height) => {
                let scale = (1u64 << shift) as f64;
                let origin = axes.map(|axis| request.bounds.min[axis] as f64 / scale);
                let step = [size[0] as f64 / scale / width as f64, size[1] as f64 / scale / height as f64];
                (width, height, origin, step)
            }
        };
        let pixels = match request.detail {
            Detail::Level(_) => PixelContent::Cell,
            Detail::Size(..) => PixelContent::Resampled,
            Detail::Exact(..) => PixelContent::Exact,
        };
        Ok(OutputGrid { level, source, across, axes, width, height, origin, step, pixels })
    }
}

impl OutputGrid {
    /// Extends the grid by up to `margin` pixels on each side (left, top, right, bottom), as long
    /// as the pixel centres lie in the tree's extent. Returns the grid and the number of pixels
    /// added per side.
    pub(super) fn extended(&self, tree: &Dataset, margin: u64) -> (OutputGrid, [u64; 4]) {
        let extent = tree.extent_at(self.level);
        let mut grid = OutputGrid { ..*self };
        let mut added = [0; 4];
        for (i, pixels) in [self.width, self.height].into_iter().enumerate() {
            let axis = self.axes[i];
            let end = extent.max[axis] as f64;
            let is_in = |pixel: f64| (0.0..end).contains(&(self.origin[i] + (pixel + 0.5) * self.step[i]));
            let before = (1..=margin).take_while(|back| is_in(-(*back as f64))).count() as u64;
            let after = (0..margin).take_while(|on| is_in((pixels + on) as f64)).count() as u64;
            let cells = |pixels: u64| (pixels as f64 * self.step[i]).ceil() as u64;
            grid.origin[i] -= before as f64 * self.step[i];
            grid.source.min[axis] = grid.source.min[axis].saturating_sub(cells(before));
            grid.source.max[axis] =
                (grid.source.max[axis] + cells(after)).min(extent.max[axis].max(grid.source.max[axis]));
            (added[i], added[i + 2]) = (before, after);
        }
        grid.width += added[0] + added[2];
        grid.height += added[1] + added[3];
        (grid, added)
    }
}

/// Whether resampled pixels are means of the cells that they cover. Otherwise they are the cells at
/// their centres.
pub(super) fn is_averaged(tree: &Dataset) -> bool {
    let header = tree.header();
    matches!(header.rule, Rule::Mean | Rule::Occupancy) && header.kind == DataKind::Continuous
}

/// Minimum number of cells per side of a pixel, for the level that is averaged.
///
/// Take a cell of which an edge leaves the share s inside the pixel. Its contribution is off by at
/// most s (1 - s), that is 1/4, of the range of values within the cell. With two edges per axis and
/// w cells between them, a pixel is off by at most 2 * 2 / 4w of that range: one half for w = 2. On
/// a relief the error is a third of GDAL's, which averages an overview with about one cell per
/// pixel. Twice as many cells take four times as long for a quarter of the error.
const CELLS_PER_PIXEL: u64 = 2;

/// Returns the level that pixels of a window are made of, given the window's first cell and its
/// size along columns and rows. That is the coarsest level with enough cells per pixel. A coarser
/// level, or the next finer one, is preferred if each pixel covers an integer number of its cells:
/// these are averaged without error.
fn level_for(tree: &Dataset, (first, size): ([u64; 2], [u64; 2]), (width, height): (u64, u64)) -> u8 {
    let depth = tree.depth();
    let sides = || size.into_iter().zip([width, height]);
    let enough = if is_averaged(tree) { CELLS_PER_PIXEL } else { 1 };
    let has_enough =
        |level: &u8| sides().all(|(cells, pixels)| cells >> (depth - level) >= pixels.saturating_mul(enough));
    let level = (0..=depth).find(has_enough).unwrap_or(depth);
    if !is_averaged(tree) {
        return level;
    }
    let is_even = |level: &u8| {
        let is_whole = |cells: u64| cells & ((1 << (depth - level)) - 1) == 0;
        first.into_iter().all(is_whole)
            && sides()
                .all(|(cells, pixels)| is_whole(cells) && (cells >> (depth - level)).is_multiple_of(pixels))
    };
    (0..=depth.min(level + 1)).find(is_even).unwrap_or(level)
}

/// Memory in bytes for one row of the output: its cells (the rows that a pixel covers if it is
/// resampled) and its pixels.
pub(super) fn row_bytes(value: ValueType, grid: &OutputGrid) -> u64 {
    // One byte per cell in addition to the value: its validity flag.
    let pixel = value.size() as u64 + 1;
    let row = grid.source.size()[grid.axes[0]].saturating_mul(pixel);
    match grid.pixels {
        PixelContent::Cell => return row,
        // Sums of four channels, and the areas that they cover.
        PixelContent::Exact => return grid.width.saturating_mul(pixel + 8 * size_of::<f64>() as u64),
        PixelContent::Resampled => {}
    }
    let lines = grid.step[1].ceil() as u64 + 1;
    row.saturating_mul(lines).saturating_add(grid.width.saturating_mul(pixel + size_of::<Span>() as u64))
}

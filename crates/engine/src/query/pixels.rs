//! Exact means over pixels of any size, from zone statistics for zones within one pixel, and from
//! the tree for zones that a pixel's edge cuts.

use std::ops::Range;

use super::walk::{Visitor, Walked, Zone, ended, walk, walk_source};
use crate::store::goblin::Goblin;
use crate::tree::Source;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{Value, ValueType};
use spinney_base::{Progress, Result};

/// A grid of pixels over cells of the deepest level.
#[derive(Clone, Copy, Debug)]
pub struct PixelGrid {
    /// The tree's axes along columns and rows.
    pub axes: [usize; 2],
    /// First corner of the first pixel in cells, along columns and rows.
    pub origin: [f64; 2],
    /// Width and height of a pixel in cells.
    pub step: [f64; 2],
    /// Columns and rows.
    pub size: [usize; 2],
}

impl PixelGrid {
    /// Returns the pixels that a span of cells touches along columns (0) or rows (1).
    fn touched(&self, along: usize, low: u64, high: u64) -> Range<usize> {
        // (Overlaps that only come from rounding are negligible.)
        const ROUNDING: f64 = 1e-9;
        let at = |cell: u64| (cell as f64 - self.origin[along]) / self.step[along];
        let first = (at(low) + ROUNDING).floor().max(0.0) as usize;
        first..((at(high) - ROUNDING).ceil().max(0.0) as usize).min(self.size[along])
    }

    /// Returns the overlap of a pixel and a span in cells, along columns (0) or rows (1).
    fn overlap(&self, along: usize, pixel: usize, low: u64, high: u64) -> f64 {
        let edge = |pixel: usize| self.origin[along] + pixel as f64 * self.step[along];
        (edge(pixel + 1).min(high as f64) - edge(pixel).max(low as f64)).max(0.0)
    }
}

/// Sums over the cells that pixels cover, each weighted by its area in the pixel. VOID cells and
/// missing samples do not count.
pub struct PixelSums<'a> {
    grid: PixelGrid,
    value_type: ValueType,
    depth: u8,
    /// Sums are of samples relative to this: see [`ValueType::samples_from`].
    base: Value,
    progress: &'a dyn Progress,
    /// Sum of each channel per pixel, row by row.
    pub sums: Vec<[f64; 4]>,
    /// Area in cells in which each channel has a sample, per pixel.
    pub areas: Vec<[f64; 4]>,
}

impl<'a> PixelSums<'a> {
    fn new(
        grid: PixelGrid,
        value_type: ValueType,
        depth: u8,
        base: Value,
        progress: &'a dyn Progress,
    ) -> PixelSums<'a> {
        let pixels = grid.size[0] * grid.size[1];
        let (sums, areas) = (vec![[0.0; 4]; pixels], vec![[0.0; 4]; pixels]);
        PixelSums { grid, value_type, depth, base, progress, sums, areas }
    }

    /// Sums over a box of cells that is one cell thick across the grid. The time is proportional to
    /// the nodes that pixels' edges cut, and to those without a zone above them.
    ///
    /// # Errors
    /// If the file is corrupt there, or on cancellation.
    pub fn of_file(
        tree: &Goblin,
        bounds: &Bounds,
        grid: PixelGrid,
        base: Value,
        progress: &'a dyn Progress,
    ) -> Result<PixelSums<'a>> {
        let header = tree.header();
        let mut sums = PixelSums::new(grid, header.form.value, header.depth(), base, progress);
        ended(walk(tree, bounds, &mut sums))?;
        Ok(sums)
    }

    /// [`PixelSums::of_file`] for any source.
    pub(crate) fn of_source<S: Source>(
        source: &S,
        bounds: &Bounds,
        grid: PixelGrid,
        base: Value,
        progress: &'a dyn Progress,
    ) -> Result<PixelSums<'a>> {
        let mut sums = PixelSums::new(grid, source.form().value, source.depth(), base, progress);
        ended(walk_source(source, bounds, &mut sums))?;
        Ok(sums)
    }

    /// Returns the columns and rows of the pixels that a box of cells touches.
    fn touched(&self, cells: &Bounds) -> [Range<usize>; 2] {
        [0, 1].map(|along| {
            let axis = self.grid.axes[along];
            self.grid.touched(along, cells.min[axis], cells.max[axis])
        })
    }
}

impl Visitor for PixelSums<'_> {
    fn zone(&mut self, code: Code, zone: &dyn Zone) -> Walked<bool> {
        self.progress.check()?;
        let [columns, rows] = self.touched(&code.bounds(self.depth));
        if columns.len() > 1 || rows.len() > 1 {
            return Ok(false);
        }
        if let (Some(column), Some(row)) = (columns.into_iter().next(), rows.into_iter().next()) {
            let (tally, pixel) = (zone.tally()?, row * self.grid.size[0] + column);
            for channel in 0..usize::from(self.value_type.channels) {
                self.areas[pixel][channel] += tally.present[channel] as f64;
                self.sums[pixel][channel] += tally.sum_from(self.base, channel);
            }
        }
        Ok(true)
    }

    fn block(&mut self, code: Code, value: Option<Value>, _: u64, part: Option<&Bounds>) -> Walked {
        let Some(value) = value else { return Ok(()) };
        let cells = part.copied().unwrap_or_else(|| code.bounds(self.depth));
        let samples = self.value_type.samples_from(self.base, value);
        let present = self.value_type.present(value);
        let [columns, rows] = self.touched(&cells);
        let [u, v] = self.grid.axes;
        for row in rows {
            let height = self.grid.overlap(1, row, cells.min[v], cells.max[v]);
            for column in columns.clone() {
                let area = height * self.grid.overlap(0, column, cells.min[u], cells.max[u]);
                let pixel = row * self.grid.size[0] + column;
                for (channel, sample) in
                    samples[..].iter().enumerate().filter(|(channel, _)| present[*channel])
                {
                    self.areas[pixel][channel] += area;
                    self.sums[pixel][channel] += area * sample;
                }
            }
        }
        Ok(())
    }

    fn leave(&mut self, _: Code) -> Walked {
        Ok(self.progress.check()?)
    }
}

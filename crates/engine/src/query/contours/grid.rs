//! Samples around the squares of a tile.

use super::levels::Levels;

/// Rank of a cell without a value.
pub(super) const VOID: i32 = i32::MIN;

/// Samples of a box of cells with their ranks. Cells outside of the raster have no value.
pub(super) struct ValueGrid {
    /// First column and row in the raster's cells; -1 is outside.
    pub(super) origin: [i64; 2],
    /// Columns and rows.
    pub(super) size: [usize; 2],
    /// Columns and rows of the raster.
    pub(super) extent: [i64; 2],
    /// Samples in row order; NaN for cells without one.
    pub(super) numbers: Vec<f64>,
    /// Their ranks, or [`VOID`].
    pub(super) ranks: Vec<i32>,
}

impl ValueGrid {
    /// Creates a grid of samples. Samples that are not finite count as missing.
    pub(super) fn new(
        origin: [i64; 2],
        size: [usize; 2],
        extent: [i64; 2],
        numbers: Vec<f64>,
        levels: &Levels,
    ) -> ValueGrid {
        let rank = |number: &f64| if number.is_finite() { levels.rank(*number) } else { VOID };
        let ranks = numbers.iter().map(rank).collect();
        ValueGrid { origin, size, extent, numbers, ranks }
    }

    /// Returns the index of a cell of the grid.
    #[inline]
    pub(super) fn index(&self, column: usize, row: usize) -> usize {
        row * self.size[0] + column
    }

    /// Returns whether a cell of the grid is within the raster.
    #[inline]
    pub(super) fn is_inside(&self, column: usize, row: usize) -> bool {
        let (x, y) = (self.origin[0] + column as i64, self.origin[1] + row as i64);
        (0..self.extent[0]).contains(&x) && (0..self.extent[1]).contains(&y)
    }

    /// Returns the centre of a cell, in cells.
    #[inline]
    pub(super) fn centre(&self, column: usize, row: usize) -> [f64; 2] {
        [(self.origin[0] + column as i64) as f64 + 0.5, (self.origin[1] + row as i64) as f64 + 0.5]
    }
}

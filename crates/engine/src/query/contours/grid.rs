//! The samples that the squares of a tile lie between.

use super::levels::Levels;

/// The rank of a cell without a value.
pub(super) const VOID: i32 = i32::MIN;

/// Samples of a box of cells with their ranks. Cells may lie outside of the picture, where there is nothing.
pub(super) struct ValueGrid {
    /// First column and row of the picture's cells; -1 is outside.
    pub(super) origin: [i64; 2],
    /// Columns and rows.
    pub(super) size: [usize; 2],
    /// Columns and rows of the picture.
    pub(super) picture: [i64; 2],
    /// Samples in rows; what has none is not a number.
    pub(super) numbers: Vec<f64>,
    /// Their ranks, or [`VOID`].
    pub(super) ranks: Vec<i32>,
}

impl ValueGrid {
    /// A grid of samples, of which those that are no finite numbers are none.
    pub(super) fn new(
        origin: [i64; 2],
        size: [usize; 2],
        picture: [i64; 2],
        numbers: Vec<f64>,
        levels: &Levels,
    ) -> ValueGrid {
        let rank = |number: &f64| if number.is_finite() { levels.rank(*number) } else { VOID };
        let ranks = numbers.iter().map(rank).collect();
        ValueGrid { origin, size, picture, numbers, ranks }
    }

    /// Index of a cell of the grid.
    #[inline]
    pub(super) fn index(&self, column: usize, row: usize) -> usize {
        row * self.size[0] + column
    }

    /// Whether a cell of the grid is one of the picture's.
    #[inline]
    pub(super) fn is_inside(&self, column: usize, row: usize) -> bool {
        let (x, y) = (self.origin[0] + column as i64, self.origin[1] + row as i64);
        (0..self.picture[0]).contains(&x) && (0..self.picture[1]).contains(&y)
    }

    /// The centre of a cell, in cells.
    #[inline]
    pub(super) fn centre(&self, column: usize, row: usize) -> [f64; 2] {
        [(self.origin[0] + column as i64) as f64 + 0.5, (self.origin[1] + row as i64) as f64 + 0.5]
    }
}

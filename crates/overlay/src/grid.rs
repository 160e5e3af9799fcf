//! The grid on which results lie.

use spinney_base::{Error, Result};

/// Cells across the greatest coordinate, as a power of two, unless something else is asked for.
const BITS: i32 = 42;

/// Greatest number of a cell, as a power of two: all that is computed of cells has an exact answer below it.
pub(crate) const MAX_BITS: i32 = 50;

/// Widths that cells may have: their squares, which areas are told in, are doubles, too, with room for the number of cells.
const WIDTHS: std::ops::RangeInclusive<f64> = 1e-120..=1e120;

/// A grid of square cells; their middles are multiples of their side, a power of two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OverlayGrid {
    exponent: i32,
}

impl OverlayGrid {
    /// The grid of coordinates up to a number (of either sign), of which 2^42 cells are across that: micrometres on the scale of a country.
    pub fn for_coordinates(greatest: f64) -> OverlayGrid {
        OverlayGrid::with_bits(greatest, BITS)
    }

    /// The grid of coordinates up to a number (of either sign), of which two to the power of `bits` cells are across that.
    pub(crate) fn with_bits(greatest: f64, bits: i32) -> OverlayGrid {
        let exponent = exponent_of(greatest.abs().max(f64::MIN_POSITIVE)) + 1 - bits;
        OverlayGrid { exponent: exponent.max(-900) }
    }

    /// The grid whose cells are as wide as a number, or the next smaller power of two.
    ///
    /// # Errors
    /// If it is not positive.
    pub fn of_cells(width: f64) -> Result<OverlayGrid> {
        if !WIDTHS.contains(&width) {
            return Err(Error::invalid("width of cells to snap to", width.to_string(), "a positive number"));
        }
        Ok(OverlayGrid { exponent: exponent_of(width) })
    }

    /// Width of a cell.
    pub fn width(self) -> f64 {
        power_of_two(self.exponent)
    }

    /// A coordinate in cells, exactly; `None` if it is too great for the grid, or no number.
    pub(crate) fn in_cells(self, coordinate: f64) -> Option<f64> {
        // (In two steps, neither of which leaves the range of doubles.)
        let half = self.exponent / 2;
        let scaled = coordinate / power_of_two(half) / power_of_two(self.exponent - half);
        let is_exact = coordinate == 0.0 || scaled.abs() >= f64::MIN_POSITIVE;
        match scaled.abs() < power_of_two(MAX_BITS) {
            // (What is so small is nothing on this grid, nor beside any other corner.)
            true => Some(if is_exact { scaled } else { 0.0 }),
            false => None,
        }
    }

    /// The coordinate of a cell's middle.
    pub(crate) fn coordinate(self, cell: i64) -> f64 {
        let half = self.exponent / 2;
        cell as f64 * power_of_two(half) * power_of_two(self.exponent - half)
    }
}

/// The greatest power of two that is not greater than a positive number.
fn exponent_of(number: f64) -> i32 {
    ((number.to_bits() >> 52) as i32).max(1) - 1023
}

fn power_of_two(exponent: i32) -> f64 {
    debug_assert!((-1022..=1023).contains(&exponent));
    f64::from_bits(((exponent + 1023) as u64) << 52)
}

/// The cell that a coordinate lies in: from half a cell before its middle on.
pub(crate) fn cell_of(coordinate: f64) -> i64 {
    // (Exact: numbers are below 2^50, of which doubles have halves.)
    let floor = coordinate.floor();
    floor as i64 + i64::from(coordinate - floor >= 0.5)
}

//! The grid of output coordinates.

use spinney_base::{Error, Result};

/// Default number of cells, as a power of two, from 0 to the power of two above the largest
/// coordinate.
const BITS: i32 = 42;

/// Bound of cell numbers, as a power of two. Computations on cells below it are exact.
pub(crate) const MAX_BITS: i32 = 50;

/// Valid cell widths. The squares of these, the unit of areas, are normal doubles, even multiplied
/// by a number of cells.
const WIDTHS: std::ops::RangeInclusive<f64> = 1e-120..=1e120;

/// A grid of square cells. Cell centres are multiples of the cell width, which is a power of two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OverlayGrid {
    exponent: i32,
}

impl OverlayGrid {
    /// Returns the grid for coordinates of a magnitude up to `max_coordinate`. The cell width is
    /// the power of two above `max_coordinate`, divided by 2^42: below a micrometre at the scale of
    /// a country in metres.
    pub fn for_coordinates(max_coordinate: f64) -> OverlayGrid {
        OverlayGrid::with_bits(max_coordinate, BITS)
    }

    /// Returns the grid for coordinates of a magnitude up to `max_coordinate`. The cell width is
    /// the power of two above `max_coordinate`, divided by `2^bits`.
    pub(crate) fn with_bits(max_coordinate: f64, bits: i32) -> OverlayGrid {
        let exponent = exponent_of(max_coordinate.abs().max(f64::MIN_POSITIVE)) + 1 - bits;
        OverlayGrid { exponent: exponent.max(-900) }
    }

    /// Returns the grid whose cell width is `width`, rounded down to a power of two.
    ///
    /// # Errors
    /// If `width` is not between 1e-120 and 1e120.
    pub fn of_cells(width: f64) -> Result<OverlayGrid> {
        if !WIDTHS.contains(&width) {
            return Err(Error::invalid(
                "cell width of the overlay grid",
                width.to_string(),
                "1e-120 to 1e120",
            ));
        }
        Ok(OverlayGrid { exponent: exponent_of(width) })
    }

    /// Returns the cell width, in units of the coordinates.
    pub fn width(self) -> f64 {
        power_of_two(self.exponent)
    }

    /// Converts a coordinate to units of cells, exactly. `None` if it is too large for the grid or
    /// not finite.
    pub(crate) fn in_cells(self, coordinate: f64) -> Option<f64> {
        // (Scaled twice, so that neither factor leaves the range of doubles.)
        let half = self.exponent / 2;
        let scaled = coordinate / power_of_two(half) / power_of_two(self.exponent - half);
        let is_exact = coordinate == 0.0 || scaled.abs() >= f64::MIN_POSITIVE;
        match scaled.abs() < power_of_two(MAX_BITS) {
            // (A subnormal result is 0 on this grid, and negligible relative to any other vertex.)
            true => Some(if is_exact { scaled } else { 0.0 }),
            false => None,
        }
    }

    /// Returns the coordinate of a cell's centre.
    pub(crate) fn coordinate(self, cell: i64) -> f64 {
        let half = self.exponent / 2;
        cell as f64 * power_of_two(half) * power_of_two(self.exponent - half)
    }
}

/// Exponent of the largest power of two that does not exceed a positive number.
fn exponent_of(number: f64) -> i32 {
    ((number.to_bits() >> 52) as i32).max(1) - 1023
}

fn power_of_two(exponent: i32) -> f64 {
    debug_assert!((-1022..=1023).contains(&exponent));
    f64::from_bits(((exponent + 1023) as u64) << 52)
}

/// Returns the cell of a coordinate: a cell begins half a cell before its centre.
pub(crate) fn cell_of(coordinate: f64) -> i64 {
    // (Exact: numbers are below 2^50, where doubles represent halves.)
    let floor = coordinate.floor();
    floor as i64 + i64::from(coordinate - floor >= 0.5)
}

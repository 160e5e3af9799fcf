//! The integer grid of a model, and its position in the world.

use crate::exact::bounds::MAX_BITS;
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_crs::{Crs, Frame};

/// A grid of points at multiples of a step in the world. Coordinates count from the model's minimum
/// coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Bits of a coordinate: all coordinates are below `2^bits`.
    pub bits: u8,
    /// World position of the point 0, 0, 0, in steps from the world's origin.
    pub origin: [i64; 3],
    /// The step is `step / divisor`. A step of 1 / 1000 gives decimals that are exact to the last
    /// bit of a double; 0.001 would not.
    pub step: f64,
    /// Divisor of the step.
    pub divisor: f64,
}

impl Grid {
    /// Returns the width of a grid unit in the world.
    pub fn width(&self) -> f64 {
        self.step / self.divisor
    }

    /// Returns the depth of the octree over the grid. Its smallest cells have one point, or the
    /// minimum number that FD codes allow.
    pub fn depth(&self) -> u8 {
        self.bits.min(Dimension::Oct.max_depth())
    }

    /// Returns the world position of a grid point. It is the nearest double if the step is a power
    /// of two or a decimal fraction.
    #[inline]
    pub fn to_world(&self, point: [i32; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.coordinate(self.origin[axis] + i64::from(point[axis])))
    }

    /// Returns the world position of an off-grid point.
    pub(crate) fn to_world_between(&self, point: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| (self.origin[axis] as f64 + point[axis]) * self.step / self.divisor)
    }

    /// Returns the world coordinate of a number of steps.
    #[inline]
    fn coordinate(&self, steps: i64) -> f64 {
        steps as f64 * self.step / self.divisor
    }

    /// Converts a world point to grid coordinates, without rounding.
    pub fn to_grid(&self, point: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| point[axis] * self.divisor / self.step - self.origin[axis] as f64)
    }

    /// Returns the grid point nearest to a world point, or `None` if it is outside of the grid.
    #[inline]
    pub fn snap(&self, point: [f64; 3]) -> Option<[i32; 3]> {
        let mut snapped = [0; 3];
        for axis in 0..3 {
            let steps = (point[axis] * self.divisor / self.step).round_ties_even();
            // (Above 2^53, doubles skip integers, but such positions are outside of the grid
            // anyway.)
            let at = steps - self.origin[axis] as f64;
            if !(0.0..(1u64 << self.bits) as f64).contains(&at) {
                return None;
            }
            snapped[axis] = at as i32;
        }
        Some(snapped)
    }

    /// Returns the number of steps of a finer grid per step of this grid, or `None` if it is not an
    /// integer.
    pub(crate) fn steps_of(&self, finer: &Grid) -> Option<i64> {
        // (Common factors are cancelled first: products of arbitrary numbers would be rounded.)
        let (step, finer_step) = if self.step == finer.step { (1.0, 1.0) } else { (self.step, finer.step) };
        let (divisor, finer_divisor) =
            if self.divisor == finer.divisor { (1.0, 1.0) } else { (self.divisor, finer.divisor) };
        let (own, its) = (step * finer_divisor, finer_step * divisor);
        let times = (own / its).round();
        // (Rounded products cannot be compared.)
        let is_exact = step.mul_add(finer_divisor, -own) == 0.0
            && finer_step.mul_add(divisor, -its) == 0.0
            && times.mul_add(its, -own) == 0.0;
        (is_exact && (1.0..=(1u64 << MAX_BITS) as f64).contains(&times)).then_some(times as i64)
    }

    /// Returns the frame of the smallest cells of an octree over the grid.
    pub fn frame(&self, crs: Option<Crs>) -> Frame {
        let mut frame = Frame { crs, ..Frame::identity() };
        let steps = (1u64 << (self.bits - self.depth())) as f64;
        // Cell walls are halfway between grid points.
        let corner = self.to_world_between([-0.5; 3]);
        for (axis, row) in frame.matrix.iter_mut().enumerate() {
            row[axis] = steps * self.width();
            row[3] = corner[axis];
        }
        frame
    }

    /// Creates a grid over a box, which is given by its minimum and maximum coordinates.
    ///
    /// Without a width, the step is the smallest power of two with which the box has at most about
    /// `2^24` units along its longest side, a quarter of a grid's maximum. Coordinates with few
    /// bits are then exact, and models of up to four times the smallest one's size can share a grid
    /// without rounding. A width that is the reciprocal of an integer is stored as a fraction.
    ///
    /// # Errors
    /// If the given width is not a positive number, or is too small for the box.
    pub fn over(bounds: [[f64; 3]; 2], width: Option<f64>) -> Result<Grid> {
        if let Some(width) = width {
            if !(width.is_normal() && width > 0.0) {
                return Err(Error::invalid("grid", width.to_string(), "a width above zero"));
            }
            let whole = (1.0 / width).round();
            // (Powers of two need no divisor.)
            let is_power = width.to_bits() << 12 == 0;
            let is_fraction = width < 1.0 && 1.0 / whole == width && !is_power;
            let (step, divisor) = if is_fraction { (1.0, whole) } else { (width, 1.0) };
            return Grid::fit(bounds, step, divisor).ok_or_else(|| {
                let least = Grid::least(bounds).width();
                let found = format!("a unit of {width}");
                Error::invalid(
                    "grid",
                    found,
                    format!("at least {least}, for at most 2^26 units along an axis"),
                )
            });
        }
        Ok(Grid::least(bounds))
    }

    /// Returns the grid with the smallest power of two over a box.
    fn least(bounds: [[f64; 3]; 2]) -> Grid {
        /// Maximum number of steps along a side. A box whose points were snapped should get the
        /// same grid again, and so should not be at the limit. Hence a number that does not result
        /// from lengths that people choose.
        const MAX_STEPS: f64 = 15_707_963.0;
        /// Minimum width of a step: coordinates would otherwise be denormal numbers, which have
        /// fewer bits.
        const MIN_STEP: f64 = 1e-290;
        let [min, max] = bounds;
        let half = (0..3).map(|axis| max[axis] / 2.0 - min[axis] / 2.0).fold(0.0, f64::max);
        let farthest = min.iter().chain(&max).fold(0.0, |most: f64, at| most.max(at.abs()));
        // The step is no finer than the spacing of doubles.
        let least =
            (half / (1u64 << (MAX_BITS - 3)) as f64).max(farthest / (1u64 << 52) as f64).max(MIN_STEP);
        let mut step = f64::from_bits(least.to_bits() & 0x7ff0_0000_0000_0000);
        loop {
            let is_coarse = half / step <= MAX_STEPS / 2.0;
            if let Some(grid) = Grid::fit(bounds, step, 1.0).filter(|_| is_coarse) {
                return grid;
            }
            step *= 2.0;
        }
    }

    /// Returns the grid of a step over a box, or `None` if it would have too many points.
    pub(crate) fn fit([min, max]: [[f64; 3]; 2], step: f64, divisor: f64) -> Option<Grid> {
        let steps = |at: f64| (at * divisor / step).round_ties_even();
        // Integers up to this limit are exact doubles.
        let exact = (1u64 << 53) as f64;
        let mut origin = [0; 3];
        let mut most = 0;
        for axis in 0..3 {
            let (low, high) = (steps(min[axis]), steps(max[axis]));
            let is_exact = low.abs() <= exact && high.abs() <= exact;
            if !is_exact || high - low >= (1u64 << MAX_BITS) as f64 {
                return None;
            }
            origin[axis] = low as i64;
            most = most.max((high - low) as u64);
        }
        let bits = (64 - most.leading_zeros() as u8).max(1);
        Some(Grid { bits, origin, step, divisor })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_with_few_bits_stay() {
        let grid = Grid::over([[0.0; 3], [1.0, 2.0, 3.0]], None).unwrap();
        for point in [[0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [0.5, 0.25, 2.75]] {
            assert_eq!(grid.to_world(grid.snap(point).unwrap()), point);
        }
        assert_eq!(grid.bits, 24);
        assert_eq!(grid.snap([0.0, 0.0, -1.0]), None);
    }

    #[test]
    fn decimals_are_exact_on_a_decimal_grid() {
        let grid = Grid::over([[84_000.001, 0.0, 0.0], [84_001.5, 1.0, 1.0]], Some(0.001)).unwrap();
        for thousandths in 84_000_001..84_001_500 {
            let x = format!("{}.{:03}", thousandths / 1000, thousandths % 1000).parse().unwrap();
            assert_eq!(grid.to_world(grid.snap([x, 0.0, 0.0]).unwrap())[0], x);
        }
        assert!(Grid::over([[0.0; 3], [1e6, 0.0, 0.0]], Some(0.001)).is_err());
        assert!(Grid::over([[0.0; 3], [1.0; 3]], Some(0.0)).is_err());
    }

    /// The box of snapped points has the same grid.
    #[test]
    fn the_grid_of_what_was_moved_is_the_same() {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        for round in 0..20_000 {
            let extent = match round % 3 {
                0 => random() * 10.0,
                // Almost a power of two in length.
                1 => 1.0 + (random() - 0.5) * 1e-7,
                _ => 1.0 - random() / (1u64 << 24) as f64,
            };
            let min = [random() - 0.5, random(), 1000.0 * random()];
            let bounds = [min, [min[0] + extent, min[1] + extent / 2.0, min[2]]];
            let grid = Grid::over(bounds, None).unwrap();
            let moved = bounds.map(|corner| grid.to_world(grid.snap(corner).unwrap()));
            assert_eq!(Grid::over(moved, None).unwrap(), grid, "{bounds:?}");
        }
    }

    #[test]
    fn far_away_the_grid_is_as_fine_as_doubles_are() {
        let grid = Grid::over([[1e15, 0.0, 0.0], [1e15 + 1.0, 1.0, 1.0]], None).unwrap();
        assert_eq!(grid.width(), 0.125);
        assert!(Grid::over([[f64::MIN; 3], [f64::MAX; 3]], None).is_ok());
    }
}

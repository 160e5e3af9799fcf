//! Motions that map the points of a grid to those of another one: nothing of a model is rounded.

use super::map::{Motion, Symmetry};
use crate::arrangement::{Corner, ExactFace, ExactPlane, ExactPoint};
use crate::{ExactModel, Faces, Grid, MAX_BITS};
use spinney_base::{Error, Result};

/// A motion between grids: axes are permuted and mirrored, the grid unit is scaled, and the origin
/// moves.
pub(super) struct Lattice {
    /// The grid of the result.
    pub(super) grid: Grid,
    from: [usize; 3],
    mirrored: [bool; 3],
    /// New grid units per old one.
    times: i64,
    /// Coordinate of the old grid's last point, along each axis.
    most: i64,
    /// The distance between result and motion: less than a grid unit, and the same for all
    /// vertices.
    pub(super) displacement: f64,
}

/// Maximum number of new grid units per old one, to make a shift an integer number of them.
const MAX_TIMES: i64 = 1000;

/// Returns the fractional part of a number of grid units; 0 if it may be a rounding error.
fn part(steps: f64) -> f64 {
    /// For a shift that people write with a few decimals.
    const MIN_REMAINDER: f64 = 1e-6;
    /// For a few roundings of large numbers, limited to a quarter of a grid unit.
    const SHARE: f64 = 5.0 * f64::EPSILON;
    let part = steps - steps.round();
    if part.abs() <= MIN_REMAINDER.max((steps.abs() * SHARE).min(0.25)) { 0.0 } else { part }
}

/// Maximum distance from the world's origin in files, in grid units.
const FARTHEST: u64 = 1 << 53;

impl Lattice {
    /// Returns the motion of a model's grid, or `None` if it is not mapped to another grid. If a
    /// shift is not an integer number of grid units, the units are subdivided if the grid's bits
    /// allow it. Otherwise, the shift is rounded.
    pub(super) fn of(model: &ExactModel, motion: &Motion) -> Result<Option<Lattice>> {
        let Some(Symmetry { scale, from, mirrored }) = motion.symmetry() else { return Ok(None) };
        let old = model.grid();
        let shift = motion.shift();
        let last = (1i64 << old.bits) - 1;
        // (Proxies are up to half a unit of this grid from their faces, so the grid must not be
        // refined.)
        let max_times = if model.has_exact_faces() { 1 } else { ((1 << MAX_BITS) - 1) / last };
        let steps = |grid: &Grid| shift.map(|at| at * grid.divisor / grid.step);
        let mut found = None;
        for times in 1..=max_times.min(MAX_TIMES) {
            let grid = scaled(old, scale, times)?;
            let is_whole = steps(&grid).iter().all(|at| part(*at) == 0.0);
            if is_whole || found.is_none() {
                found = Some((times, grid));
            }
            if is_whole {
                break;
            }
        }
        let Some((times, mut grid)) = found else { return Ok(None) };
        // Invariant: mirroring an axis maps the cube of grid points to itself, the last points to
        // the first. So off-grid vertices, which are less than a grid unit outside of the first or
        // last grid points, stay within that distance, as readers require. And the inverse motion
        // restores the same numbers.
        let most = last * times;
        let mut squared_displacement = 0.0;
        for axis in 0..3 {
            let more = steps(&grid)[axis];
            let start = times * old.origin[from[axis]];
            let start = if mirrored[axis] { -start - most } else { start };
            let there = (more.round() as i128).saturating_add(start.into());
            if there.unsigned_abs() > FARTHEST.into() {
                let found = format!("a position {there} units of {} from the world's origin", grid.width());
                let expected = "at most 2^53 units: choose a coarser grid with --snap";
                return Err(Error::invalid("result", found, expected));
            }
            grid.origin[axis] = there as i64;
            squared_displacement += (part(more) * grid.width()).powi(2);
        }
        Ok(Some(Lattice { grid, from, mirrored, times, most, displacement: squared_displacement.sqrt() }))
    }

    /// Returns whether face coordinates are unchanged, and only the grid is moved.
    pub(super) fn is_only_the_grid(&self) -> bool {
        self.from == [0, 1, 2] && self.mirrored == [false; 3] && self.times == 1 && self.displacement == 0.0
    }

    /// Maps a grid point.
    #[inline]
    pub(super) fn point(&self, point: [i32; 3]) -> [i32; 3] {
        [0, 1, 2].map(|axis| {
            let at = self.times * i64::from(point[self.from[axis]]);
            (if self.mirrored[axis] { self.most - at } else { at }) as i32
        })
    }

    /// Maps a face with off-grid vertices; the order of its vertices is unchanged.
    pub(super) fn exact(&self, face: ExactFace) -> ExactFace {
        let shift = self.mirrored.map(|is_mirrored| if is_mirrored { self.most } else { 0 });
        let plane = |plane: ExactPlane| plane.permuted(self.from, self.mirrored).placed(self.times, shift);
        let point = |point: ExactPoint| point.permuted(self.from, self.mirrored).placed(self.times, shift);
        let corner = |Corner { point: at, line }: Corner| Corner { point: point(at), line: plane(line) };
        ExactFace {
            plane: plane(face.plane),
            corners: face.corners.into_iter().map(corner).collect(),
            ..face
        }
    }
}

/// Scales a grid, whose old unit becomes `times` new ones, by a factor for all lengths.
fn scaled(old: &Grid, scale: f64, times: i64) -> Result<Grid> {
    let (factor, part) = fraction(scale);
    let (step, divisor) = reduced(old.step * factor, old.divisor * part * times as f64);
    let most = ((1i64 << old.bits) - 1) * times;
    let grid = Grid { bits: 64 - most.leading_zeros() as u8, origin: [0; 3], step, divisor };
    if [step, divisor, grid.width()].iter().all(|number| number.is_normal()) {
        return Ok(grid);
    }
    let found = format!("grid unit {} times {scale}", old.width());
    Err(Error::invalid("scale", found, "a product that is a normal number, neither 0 nor infinite"))
}

/// Returns a number as a quotient: of integers, if it is a decimal fraction or the reciprocal of an
/// integer.
fn fraction(number: f64) -> (f64, f64) {
    let whole = |number: f64| number == number.round() && (1.0..=FARTHEST as f64).contains(&number);
    if number.to_bits() << 12 == 0 {
        // Powers of two need no divisor.
        return (number, 1.0);
    }
    let decimals = (0..10).map(|digits| 10f64.powi(digits));
    let found = decimals.map(|divisor| ((number * divisor).round(), divisor));
    let reciprocal = (1.0, (1.0 / number).round());
    let mut found = found.chain([reciprocal]).filter(|(a, b)| whole(*a) && whole(*b) && a / b == number);
    found.next().unwrap_or((number, 1.0))
}

/// Reduces a step and its divisor to lowest terms, in integers if these are small enough, so that
/// equal quotients are equal pairs.
fn reduced(step: f64, divisor: f64) -> (f64, f64) {
    // An odd number, and the power of two that it is multiplied by.
    let parts = |number: f64| {
        let bits = number.to_bits();
        let odd = bits & ((1 << 52) - 1) | 1 << 52;
        (odd >> odd.trailing_zeros(), (bits >> 52) as i32 - 1075 + odd.trailing_zeros() as i32)
    };
    if ![step, divisor].iter().all(|number| number.is_normal()) {
        return (step, divisor);
    }
    let ((a, i), (b, j)) = (parts(step), parts(divisor));
    let common = common_divisor(a, b);
    let (a, b, power) = ((a / common) as f64, (b / common) as f64, i - j);
    // (By halves: the power itself may be out of the doubles' range.)
    let times = |number: f64, power: i32| number * 2f64.powi(power / 2) * 2f64.powi(power - power / 2);
    let whole = times(b, -power);
    match b > 1.0 && power < 0 && whole <= FARTHEST as f64 {
        true => (a, whole),
        false => (times(a, power), b),
    }
}

fn common_divisor(mut a: u64, mut b: u64) -> u64 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_grids_are_in_lowest_terms_already() {
        let over = |width: f64| Grid::over([[0.0; 3], [1000.0 * width; 3]], Some(width)).unwrap();
        for width in [1.0, 0.001, 0.0025, 0.3, 25.4, 1.0 / 3.0, 2f64.powi(-20), 7e12] {
            let grid = over(width);
            assert_eq!(reduced(grid.step, grid.divisor), (grid.step, grid.divisor), "{width}");
        }
        // (A divisor that is not a small integer is converted to one, with the same quotient.)
        /// Near the minimum width whose product with a grid's numbers is a normal number.
        const NARROW: f64 = 1e-280;
        let grid = over(NARROW);
        let (step, divisor) = reduced(grid.step, grid.divisor);
        assert!(divisor < FARTHEST as f64 && step / divisor == grid.step / grid.divisor);
    }

    /// Decimal factors and their inverses restore the same step, whatever was in between.
    #[test]
    fn factors_that_cancel_leave_the_step() {
        let scaled = |(step, divisor): (f64, f64), factor: f64| {
            let (a, b) = fraction(factor);
            reduced(step * a, divisor * b)
        };
        for step in [(1.0, 1000.0), (1.0, 1.0), (2f64.powi(-20), 1.0), (1.0, 3.0)] {
            for (factor, inverse) in
                [(1000.0, 0.001), (4.0, 0.25), (2.5, 0.4), (3.0, 1.0 / 3.0), (8.0, 0.125)]
            {
                let there = scaled(step, factor);
                assert_eq!(scaled(there, inverse), step, "{factor}");
                // (The product of a quotient is rounded twice.)
                let (quotient, expected) = (there.0 / there.1, step.0 / step.1 * factor);
                assert!((quotient - expected).abs() <= f64::EPSILON * expected, "{quotient} {expected}");
            }
        }
        assert_eq!(scaled((1.0, 1.0), 25.4), (127.0, 5.0));
        assert_eq!(scaled((1.0, 1000.0), 1000.0), (1.0, 1.0));
    }
}

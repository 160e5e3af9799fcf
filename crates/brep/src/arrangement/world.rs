//! Conversion of exact points to world coordinates, as the nearest doubles.

use bnum::cast::As;
use bnum::types::{I512, U512, U1024};

use super::point::ExactPoint;
use crate::Grid;

impl ExactPoint {
    /// Returns the point in world coordinates. A grid point is converted as in models; the
    /// coordinates of other points are rounded once. An undefined point, which only a face that is
    /// not flat can have, becomes NaN.
    pub(crate) fn to_world(self, grid: &Grid) -> [f64; 3] {
        if let Some(at) = self.on_grid() {
            return grid.to_world(at);
        }
        if self.weight.is_zero() {
            return [f64::NAN; 3];
        }
        let ((step, step_power), (divisor, divisor_power)) = (parts(grid.step), parts(grid.divisor));
        [0, 1, 2].map(|axis| {
            // (At most 198 bits, 54 + 171, and 53 more: 279.)
            let (at, weight, origin): (I512, I512, I512) =
                (self.at[axis].as_(), self.weight.as_(), grid.origin[axis].as_());
            let steps = at + weight * origin;
            let (step, divisor): (U512, U512) = (step.as_(), divisor.as_());
            let power = step_power - divisor_power;
            let size = quotient(steps.unsigned_abs() * step, weight.unsigned_abs() * divisor, power);
            if steps.is_negative() { -size } else { size }
        })
    }
}

/// Splits a positive double into an integer and the exponent of a power of two.
fn parts(number: f64) -> (u64, i32) {
    let bits = number.to_bits();
    let (exponent, fraction) = ((bits >> 52 & 0x7ff) as i32, bits & ((1 << 52) - 1));
    if exponent == 0 { (fraction, -1074) } else { (fraction | 1 << 52, exponent - 1075) }
}

/// Returns the double nearest to a quotient times a power of two.
fn quotient(numerator: U512, denominator: U512, power: i32) -> f64 {
    let shift: i32 = 64 + denominator.bit_width() as i32 - numerator.bit_width() as i32;
    let (mut numerator, mut denominator): (U1024, U1024) = (numerator.as_(), denominator.as_());
    if shift >= 0 {
        numerator <<= shift as u32
    } else {
        denominator <<= shift.unsigned_abs()
    }
    // 64 or 65 bits. A nonzero remainder sets the lowest bit, so that ties are rounded correctly.
    let mut whole: u128 = (numerator / denominator).as_();
    whole |= u128::from(!(numerator % denominator).is_zero());
    // (In two halves, since the power itself may be out of range.)
    let power = power - shift;
    whole as f64 * 2f64.powi(power / 2) * 2f64.powi(power - power / 2)
}

#[cfg(test)]
mod tests {
    use bnum::types::I256;

    use super::*;

    fn point(at: [i64; 3], weight: i64) -> ExactPoint {
        let wide = |number: i64| -> I256 { number.as_() };
        ExactPoint::of(at.map(wide), wide(weight))
    }

    /// Quotients of integers with few bits equal the division of doubles, which rounds once, too.
    #[test]
    fn coordinates_are_rounded_once() {
        let grid = Grid { bits: 26, origin: [0, -7, 1 << 40], step: 1.0, divisor: 1.0 };
        let mut state = 3u64;
        let mut number = |bits: u32| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> (64 - bits)) as i64
        };
        for _ in 0..2000 {
            let (at, weight) = ([number(26), number(24), 0], 1 + number(20));
            let found = point(at, weight).to_world(&grid);
            assert_eq!(found[0], at[0] as f64 / weight as f64);
            assert_eq!(found[1], (at[1] - 7 * weight) as f64 / weight as f64);
            assert_eq!(found[2], (1u64 << 40) as f64);
        }
        // A third of a grid unit of a thousandth: a single division.
        let grid = Grid { bits: 26, origin: [0; 3], step: 1.0, divisor: 1000.0 };
        assert_eq!(point([1, 2, 3], 3).to_world(&grid), [1.0 / 3000.0, 2.0 / 3000.0, 0.001]);
        let grid = Grid { bits: 26, origin: [0; 3], step: 1e-290, divisor: 1.0 };
        assert_eq!(point([1, 0, 4], 2).to_world(&grid), [5e-291, 0.0, 2e-290]);
    }
}

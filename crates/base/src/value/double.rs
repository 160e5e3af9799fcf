//! Double-double numbers: sums of floating samples with twice the digits of an f64.

use std::ops::{Add, Div, Mul, Sub};

/// Double-double number: the unevaluated sum of an f64 and its rounding error, with some 106 bits.
///
/// Sums and products are those of Dekker and Knuth. They use IEEE 754 operations only, so results
/// are the same on all platforms. If `high` is not finite, `low` is 0. Neither is -0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DoubleDouble {
    /// The nearest f64.
    pub high: f64,
    /// The remainder.
    pub low: f64,
}

impl DoubleDouble {
    /// Adds two numbers, the first of which must not be the smaller one in magnitude.
    #[inline]
    fn of_parts(high: f64, low: f64) -> DoubleDouble {
        let sum = high + low;
        // An infinite sum has no remainder.
        DoubleDouble { high: sum, low: if sum.is_finite() { low - (sum - high) } else { 0.0 } }
    }

    /// Returns the exact product of two numbers (rounded if the remainder underflows).
    #[inline]
    pub fn product(a: f64, b: f64) -> DoubleDouble {
        let (a_high, a_low) = halves(a);
        let (b_high, b_low) = halves(b);
        let high = a * b;
        let low = a_low * b_low - (((high - a_high * b_high) - a_low * b_high) - a_high * b_low);
        DoubleDouble::of_parts(high, if low.is_finite() { low } else { 0.0 })
    }

    /// Converts a count. Nearly all counts are exact in an f64, whose conversion is one
    /// instruction; that of an i128 is a call.
    #[inline]
    fn of_count(count: u64) -> DoubleDouble {
        if count < 1 << f64::MANTISSA_DIGITS {
            DoubleDouble { high: count as f64, low: 0.0 }
        } else {
            DoubleDouble::from(i128::from(count))
        }
    }

    /// Multiplies by a count.
    #[inline]
    pub(super) fn times(self, count: u64) -> DoubleDouble {
        let DoubleDouble { high, low } = self;
        if count.is_power_of_two() {
            // The usual case: a power of two is exact.
            let count = count as f64;
            let high = high * count;
            return DoubleDouble { high, low: if high.is_finite() { low * count } else { 0.0 } };
        }
        self * DoubleDouble::of_count(count)
    }
}

/// Splits a number into two with half as many digits each.
#[inline]
fn halves(number: f64) -> (f64, f64) {
    /// 2^27 + 1.
    const SPLIT: f64 = 134_217_729.0;
    let large = number * SPLIT;
    let high = large - (large - number);
    (high, number - high)
}

impl From<f64> for DoubleDouble {
    #[inline]
    fn from(number: f64) -> DoubleDouble {
        DoubleDouble { high: number + 0.0, low: 0.0 }
    }
}

impl From<i128> for DoubleDouble {
    fn from(number: i128) -> DoubleDouble {
        let high = number as f64;
        DoubleDouble { high, low: number.wrapping_sub(high as i128) as f64 }
    }
}

impl Add for DoubleDouble {
    type Output = DoubleDouble;

    #[inline]
    fn add(self, other: DoubleDouble) -> DoubleDouble {
        let sum = self.high + other.high;
        let share = sum - self.high;
        let rest = (self.high - (sum - share)) + (other.high - share) + (self.low + other.low);
        let high = sum + rest;
        // The remainder of an infinite sum is NaN. Selects instead of branches let the compiler
        // vectorize loops.
        DoubleDouble {
            high: if sum.is_finite() { high } else { sum },
            low: if high.is_finite() { rest - (high - sum) } else { 0.0 },
        }
    }
}

impl Sub for DoubleDouble {
    type Output = DoubleDouble;

    fn sub(self, other: DoubleDouble) -> DoubleDouble {
        self + DoubleDouble { high: -other.high, low: -other.low }
    }
}

impl Mul for DoubleDouble {
    type Output = DoubleDouble;

    fn mul(self, other: DoubleDouble) -> DoubleDouble {
        let DoubleDouble { high, low } = DoubleDouble::product(self.high, other.high);
        if !high.is_finite() {
            return DoubleDouble { high, low: 0.0 };
        }
        DoubleDouble::of_parts(high, low + (self.high * other.low + self.low * other.high))
    }
}

impl Div for DoubleDouble {
    type Output = DoubleDouble;

    fn div(self, other: DoubleDouble) -> DoubleDouble {
        // Two digits of a long division.
        let first = DoubleDouble::from(self.high / other.high);
        let rest = self - other * first;
        first + DoubleDouble::from(rest.high / other.high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_and_sums_keep_what_an_f64_cannot() {
        let third = 1.0 / 3.0;
        let square = DoubleDouble::product(third, third);
        assert_eq!(square.high, third * third);
        assert_eq!(square.low, third.mul_add(third, -square.high));
        assert!(square.low != 0.0);
        let sum = DoubleDouble::from(1e16) + DoubleDouble::from(1.0) + DoubleDouble::from(-1e16);
        assert_eq!((sum.high, sum.low), (1.0, 0.0));
        let number = (1i128 << 100) + 12345;
        assert_eq!((DoubleDouble::from(number) - DoubleDouble::from(1i128 << 100)).high, 12345.0);
        let seventh = DoubleDouble::from(1.0) / DoubleDouble::from(7.0);
        let one = seventh.times(7) - DoubleDouble::from(1.0);
        assert!(one.high.abs() < 1e-31, "{one:?}");
        // A count that is not exact in an f64.
        let count = (1u64 << 60) + 1;
        assert_eq!((DoubleDouble::from(3.0).times(count) - DoubleDouble::from(3.0).times(1 << 60)).high, 3.0);
    }

    #[test]
    fn doubling_changes_no_bit() {
        for number in [0.1, -1e300, 1.7e9, 5e-324, -0.0, f64::INFINITY, f64::MAX] {
            for one in [DoubleDouble::from(number), DoubleDouble::product(number, number)] {
                let (twice, sum) = (one.times(2), one + one);
                assert_eq!((twice.high.to_bits(), twice.low), (sum.high.to_bits(), sum.low), "{number}");
                let with_nothing = one + DoubleDouble::default();
                assert_eq!((with_nothing.high.to_bits(), with_nothing.low), (one.high.to_bits(), one.low));
            }
        }
    }

    #[test]
    fn what_is_not_finite_has_no_rest() {
        let (large, infinite) = (DoubleDouble::from(f64::MAX), DoubleDouble::from(f64::INFINITY));
        for (number, expected) in [
            (large + large, f64::INFINITY),
            (large * large, f64::INFINITY),
            (DoubleDouble::product(1e200, 1e200), f64::INFINITY),
            (DoubleDouble::product(1e200, -1e200), f64::NEG_INFINITY),
            (infinite + large, f64::INFINITY),
            (DoubleDouble { high: 1.0, low: f64::INFINITY } + large, f64::INFINITY),
        ] {
            assert_eq!((number.high, number.low), (expected, 0.0));
        }
        let neither = infinite - infinite;
        assert!(neither.high.is_nan() && neither.low == 0.0);
    }
}

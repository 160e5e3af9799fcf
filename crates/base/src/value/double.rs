//! Double-double numbers: sums of floating samples with twice the digits of an f64.

use std::ops::{Add, Div, Mul, Sub};

/// A number as the sum of two, the second of which is what the first is rounded by: some 106 bits.
///
/// Sums and products are those of Dekker and Knuth, of IEEE 754 operations alone, so that they are the same everywhere.
/// Numbers that are not finite have no second one, and neither is zero negative.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DoubleDouble {
    /// The f64 that is nearest.
    pub high: f64,
    /// The rest.
    pub low: f64,
}

impl DoubleDouble {
    /// A sum of two numbers of which the first is not the smaller.
    #[inline]
    fn of_parts(high: f64, low: f64) -> DoubleDouble {
        let sum = high + low;
        // (An infinite sum has no rest.)
        DoubleDouble { high: sum, low: if sum.is_finite() { low - (sum - high) } else { 0.0 } }
    }

    /// The product of two numbers, exactly (unless the rest is too small for an f64).
    #[inline]
    pub fn product(a: f64, b: f64) -> DoubleDouble {
        let (a_high, a_low) = halves(a);
        let (b_high, b_low) = halves(b);
        let high = a * b;
        let low = a_low * b_low - (((high - a_high * b_high) - a_low * b_high) - a_high * b_low);
        DoubleDouble::of_parts(high, if low.is_finite() { low } else { 0.0 })
    }

    /// A count. Nearly all are numbers that an f64 has, for which there is an instruction; an i128 takes calls.
    #[inline]
    fn of_count(count: u64) -> DoubleDouble {
        if count < 1 << f64::MANTISSA_DIGITS {
            DoubleDouble { high: count as f64, low: 0.0 }
        } else {
            DoubleDouble::from(i128::from(count))
        }
    }

    /// So many times the number.
    #[inline]
    pub(super) fn times(self, count: u64) -> DoubleDouble {
        let DoubleDouble { high, low } = self;
        if count.is_power_of_two() {
            // As most are: no digit changes.
            let count = count as f64;
            let high = high * count;
            return DoubleDouble { high, low: if high.is_finite() { low * count } else { 0.0 } };
        }
        self * DoubleDouble::of_count(count)
    }
}

/// Two numbers of half as many digits whose sum is the number.
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
        // Of an infinite sum the rest is no number. (Choices of numbers, not branches: loops of this are compiled to
        // instructions for many numbers at once.)
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
        // A count that is no f64.
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

//! Triple-double numbers: sums of squares with three times the digits of an f64.

use std::ops::{Add, Mul};

use super::double::DoubleDouble;
use super::square_sum::SquareSum;

/// Triple-double number: the unevaluated sum of three f64, each the rounding error of those before
/// it, with some 159 bits.
///
/// If samples differ little, a variance is the small difference of the mean square and the squared
/// mean, and nearly all digits cancel. For samples that differ in their last bits, twice as many
/// digits cancel as an f64 has. The remainder then still has the digits of an f64.
///
/// Sums and products use IEEE 754 operations only, so results are the same on all platforms. If
/// `high` is not finite, `middle` and `low` are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TripleDouble {
    /// The nearest f64.
    pub high: f64,
    /// The f64 nearest to the remainder.
    pub middle: f64,
    /// The remainder after that.
    pub low: f64,
}

/// Returns a sum and its rounding error.
#[inline]
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let share = sum - a;
    (sum, (a - (sum - share)) + (b - share))
}

/// Like [`two_sum`], for two numbers the first of which is not the smaller one in magnitude.
#[inline]
fn ordered_sum(large: f64, small: f64) -> (f64, f64) {
    let sum = large + small;
    (sum, small - (sum - large))
}

impl TripleDouble {
    /// Normalizes a sum of three numbers, each much larger than the next.
    ///
    /// Invariant: normalization is idempotent. Each pair is added twice, since the remainder can
    /// push a number across the midpoint between two f64.
    #[inline]
    fn of_parts(first: f64, middle: f64, low: f64) -> TripleDouble {
        let high = first;
        let (middle, low) = ordered_sum(middle, low);
        let (high, middle) = ordered_sum(high, middle);
        let (middle, low) = ordered_sum(middle, low);
        let (high, middle) = ordered_sum(high, middle);
        let (middle, low) = ordered_sum(middle, low);
        // The remainder of an infinite sum is NaN. Selects instead of branches let the compiler
        // vectorize loops.
        let is_finite = high.is_finite();
        TripleDouble {
            high: if is_finite { high } else { first },
            middle: if is_finite { middle } else { 0.0 },
            low: if is_finite { low } else { 0.0 },
        }
    }

    /// Returns the exact square of a number (rounded if the remainder underflows).
    #[inline]
    pub(super) fn square(number: f64) -> TripleDouble {
        TripleDouble::from(DoubleDouble::product(number, number))
    }

    /// Multiplies by a count.
    #[inline]
    pub(super) fn times(self, count: u64) -> TripleDouble {
        let TripleDouble { high, middle, low } = self;
        if count.is_power_of_two() {
            // The usual case: a power of two is exact.
            let count = count as f64;
            let high = high * count;
            let scaled = |part: f64| if high.is_finite() { part * count } else { 0.0 };
            return TripleDouble { high, middle: scaled(middle), low: scaled(low) };
        }
        self * DoubleDouble::from(i128::from(count))
    }

    fn terms(self) -> [f64; 3] {
        [self.high, self.middle, self.low]
    }

    /// Returns the variance of a population from the sum of its numbers, the sum of their squares,
    /// and their count, which may be fractional.
    ///
    /// If the sum of squares is not finite, the variance is infinite, or NaN if the squared mean is
    /// infinite, too.
    pub fn variance(sum: TripleDouble, squares: TripleDouble, count: DoubleDouble) -> f64 {
        // Mean squared deviation from a number near the mean, minus the squared distance of that
        // number from the mean. The sums of products are exact.
        let near = sum.high / count.high;
        if !squares.high.is_finite() {
            return squares.high - near * near;
        }
        let counts = [count.high, count.low];
        let mut deviations = squares.terms().to_vec();
        sum.terms().iter().for_each(|term| push_product(&mut deviations, -2.0 * near, *term));
        let mut square = Vec::new();
        push_product(&mut square, near, near);
        for (square, count) in square.iter().flat_map(|square| counts.map(|count| (*square, count))) {
            push_product(&mut deviations, square, count);
        }
        let mut difference = sum.terms().to_vec();
        counts.iter().for_each(|count| push_product(&mut difference, -near, *count));
        let difference = exact_sum(&difference) / count.high;
        let variance = exact_sum(&deviations) / count.high - difference * difference;
        if variance < 0.0 { 0.0 } else { variance }
    }
}

/// Appends two numbers whose sum is the exact product.
fn push_product(terms: &mut Vec<f64>, a: f64, b: f64) {
    let DoubleDouble { high, low } = DoubleDouble::product(a, b);
    terms.extend([high, low]);
}

/// Returns the sum of numbers, rounded only at the end (Shewchuk's growing expansions).
fn exact_sum(terms: &[f64]) -> f64 {
    let mut parts: Vec<f64> = Vec::new();
    for term in terms {
        let mut rest = *term;
        parts.retain_mut(|part| {
            let (sum, low) = two_sum(rest, *part);
            (rest, *part) = (sum, low);
            low != 0.0
        });
        parts.push(rest);
    }
    // In ascending order of magnitude, without overlaps.
    parts.iter().sum()
}

impl From<f64> for TripleDouble {
    #[inline]
    fn from(number: f64) -> TripleDouble {
        TripleDouble { high: number + 0.0, middle: 0.0, low: 0.0 }
    }
}

impl From<DoubleDouble> for TripleDouble {
    #[inline]
    fn from(number: DoubleDouble) -> TripleDouble {
        TripleDouble { high: number.high, middle: number.low, low: 0.0 }
    }
}

impl From<i128> for TripleDouble {
    fn from(number: i128) -> TripleDouble {
        let high = DoubleDouble::from(number >> 64) * DoubleDouble::from(2f64.powi(64));
        TripleDouble::from(high) + TripleDouble::from(DoubleDouble::from(number & i128::from(u64::MAX)))
    }
}

impl From<SquareSum> for TripleDouble {
    fn from(number: SquareSum) -> TripleDouble {
        let limbs = number.limbs().into_iter().rev();
        limbs.fold(TripleDouble::default(), |sum, limb| {
            sum.times(1 << 32).times(1 << 32) + TripleDouble::from(DoubleDouble::from(i128::from(limb)))
        })
    }
}

impl Add for TripleDouble {
    type Output = TripleDouble;

    #[inline]
    fn add(self, other: TripleDouble) -> TripleDouble {
        let (high, rest) = two_sum(self.high, other.high);
        let (middle, low) = two_sum(self.middle, other.middle);
        let (middle, rest) = two_sum(middle, rest);
        TripleDouble::of_parts(high, middle, (self.low + other.low) + (low + rest))
    }
}

impl Mul<f64> for TripleDouble {
    type Output = TripleDouble;

    fn mul(self, other: f64) -> TripleDouble {
        let high = DoubleDouble::product(self.high, other);
        let middle = DoubleDouble::product(self.middle, other);
        let (sum, rest) = two_sum(middle.high, high.low);
        TripleDouble::of_parts(high.high, sum, self.low * other + (middle.low + rest))
    }
}

impl Mul<DoubleDouble> for TripleDouble {
    type Output = TripleDouble;

    fn mul(self, other: DoubleDouble) -> TripleDouble {
        let high = self * other.high;
        if other.low == 0.0 { high } else { high + self * other.low }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the variance of numbers whose sums are added pairwise.
    fn variance(numbers: &[f64]) -> f64 {
        let squares = numbers.iter().map(|number| TripleDouble::square(*number));
        let sums = numbers.iter().map(|number| TripleDouble::from(*number));
        let add = |a: TripleDouble, b: TripleDouble| a + b;
        let (sum, squares) = (sums.reduce(add).unwrap(), squares.reduce(add).unwrap());
        TripleDouble::variance(sum, squares, DoubleDouble::from(numbers.len() as f64))
    }

    #[test]
    fn variances_are_those_of_small_differences() {
        for base in [0.0, 1.0, -8e15, 4e15, 9e15, -(2f64.powi(53) - 64.0)] {
            let numbers: Vec<f64> = (0..64).map(|index| base + f64::from(index * index % 7)).collect();
            let mean = (0..64).map(|index| f64::from(index * index % 7)).sum::<f64>() / 64.0;
            let expected =
                (0..64).map(|index| (f64::from(index * index % 7) - mean).powi(2)).sum::<f64>() / 64.0;
            let found = variance(&numbers);
            assert!((found / expected - 1.0).abs() < 1e-14, "{base}: {found} {expected}");
            assert_eq!(variance(&[base; 31]), 0.0);
        }
        // Numbers of which one differs in the last bit.
        let (number, next) = (0.1f64, 0.1f64.next_up());
        let mut numbers = vec![number; 1000];
        numbers[7] = next;
        let expected = (next - number).powi(2) * 0.001 * 0.999;
        assert!((variance(&numbers) / expected - 1.0).abs() < 1e-9);
        assert!(variance(&[f64::INFINITY, 1.0]).is_nan());
        assert_eq!(variance(&[1e200, -1e200]), f64::INFINITY);
    }

    #[test]
    fn doubling_changes_no_bit() {
        let parts = |number: TripleDouble| number.terms().map(f64::to_bits);
        let mut sum = TripleDouble::default();
        for number in [0.1, -1e150, 1.7e9, 1e-150, -0.0, 1.0 / 3.0] {
            let square = TripleDouble::square(number);
            assert_eq!(parts(square.times(2)), parts(square + square), "{number}");
            sum = sum + square;
            assert_eq!(parts(sum.times(4)), parts((sum + sum) + (sum + sum)), "{number}");
            assert_eq!(parts(sum), parts(sum + TripleDouble::default()));
            assert_eq!(parts(sum), parts(TripleDouble::default() + sum));
        }
        // A remainder that pushes the number across the midpoint between two f64.
        let edge = TripleDouble::from(1.0 + f64::EPSILON)
            + TripleDouble { high: f64::EPSILON / 2.0, middle: f64::EPSILON.powi(2) / 8.0, low: 0.0 };
        assert_eq!(parts(edge), parts(edge + TripleDouble::default()));
    }

    #[test]
    fn whole_numbers_lose_nothing() {
        for number in [0, 1, -1, i128::MAX >> 1, -(i128::MAX / 3), (1 << 122) + 1] {
            let TripleDouble { high, middle, low } = TripleDouble::from(number);
            assert_eq!(high as i128 + middle as i128 + low as i128, number);
        }
        let square = SquareSum::of(u64::MAX.into());
        let difference = TripleDouble::from(square)
            + TripleDouble::from(2f64.powi(128)) * -1.0
            + TripleDouble::from(2f64.powi(65));
        assert_eq!(difference.terms(), [1.0, 0.0, 0.0]);
        let third = TripleDouble::from(1.0 / 3.0);
        assert_eq!((third.times(3) + TripleDouble::from(-1.0)).high, -(2f64.powi(-54)));
    }

    #[test]
    fn what_is_not_finite_has_no_rest() {
        let large = TripleDouble::square(1e154);
        for number in [TripleDouble::square(1e200), large.times(1 << 60) + large, large * 1e200] {
            assert_eq!(number.terms(), [f64::INFINITY, 0.0, 0.0]);
        }
    }
}

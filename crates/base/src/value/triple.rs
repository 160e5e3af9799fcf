//! Triple-double numbers: sums of squares with three times the digits of an f64.

use std::ops::{Add, Mul};

use super::double::DoubleDouble;
use super::square_sum::SquareSum;

/// A number as the sum of three, each of which is what those before it are rounded by: some 159 bits.
///
/// Of a mean square nearly all digits cancel out against the square of the mean where samples differ little: of samples that differ in
/// their last bits, twice as many as an f64 has. What remains then has the digits of an f64.
///
/// Sums and products are made of IEEE 754 operations alone, so that they are the same everywhere. Numbers that are not finite have no
/// second and third one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TripleDouble {
    /// The f64 that is nearest.
    pub high: f64,
    /// The f64 that is nearest to the rest.
    pub middle: f64,
    /// The rest of that.
    pub low: f64,
}

/// A sum, and what it is rounded by.
#[inline]
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let share = sum - a;
    (sum, (a - (sum - share)) + (b - share))
}

/// [`two_sum`] of two numbers of which the first is not the smaller.
#[inline]
fn ordered_sum(large: f64, small: f64) -> (f64, f64) {
    let sum = large + small;
    (sum, small - (sum - large))
}

impl TripleDouble {
    /// A sum of three numbers, each of which is much larger than the next.
    ///
    /// Invariant: what comes out is left as it is by the same steps. Each pair is added twice, since the rest can push a number over
    /// the middle between two.
    #[inline]
    fn of_parts(first: f64, middle: f64, low: f64) -> TripleDouble {
        let high = first;
        let (middle, low) = ordered_sum(middle, low);
        let (high, middle) = ordered_sum(high, middle);
        let (middle, low) = ordered_sum(middle, low);
        let (high, middle) = ordered_sum(high, middle);
        let (middle, low) = ordered_sum(middle, low);
        // (Choices of numbers, not branches: loops of this are compiled to instructions for many numbers at once.)
        // Of an infinite sum the rest is no number.
        let is_finite = high.is_finite();
        TripleDouble {
            high: if is_finite { high } else { first },
            middle: if is_finite { middle } else { 0.0 },
            low: if is_finite { low } else { 0.0 },
        }
    }

    /// The square of a number, exactly (unless the rest is too small for an f64).
    #[inline]
    pub(super) fn square(number: f64) -> TripleDouble {
        TripleDouble::from(DoubleDouble::product(number, number))
    }

    /// So many times the number.
    #[inline]
    pub(super) fn times(self, count: u64) -> TripleDouble {
        let TripleDouble { high, middle, low } = self;
        if count.is_power_of_two() {
            // As most are: no digit changes.
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

    /// Variance of a population from the sum of its numbers, that of their squares, and how many they are: also of parts of numbers.
    /// Infinite where the sum of the squares alone is, and not a number where both are.
    pub fn variance(sum: TripleDouble, squares: TripleDouble, count: DoubleDouble) -> f64 {
        // Squares of differences from a number near the mean, less the square of the difference of that and the mean. Each of these
        // sums of products is exact.
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

/// Appends two numbers whose sum is a product.
fn push_product(terms: &mut Vec<f64>, a: f64, b: f64) {
    let DoubleDouble { high, low } = DoubleDouble::product(a, b);
    terms.extend([high, low]);
}

/// The sum of some numbers, rounded at the end alone (Shewchuk's growing expansions).
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
    // The smallest first, none of which overlaps the next.
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

    /// Variance and squares of some numbers, added pairwise.
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
        // Numbers that differ in the last bit of one of them.
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
        // A rest that pushes the number over the middle between two.
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

//! Exact sums of squares of 64-bit integers.

use std::ops::Add;

/// An unsigned 192-bit integer: squares of 64-bit integers have up to 128 bits, and a tree has at
/// most 2^58 cells.
///
/// Sums wrap modulo 2^192, which no tree reaches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SquareSum {
    low: u128,
    high: u64,
}

impl SquareSum {
    /// Bytes on disk.
    pub(super) const SIZE: usize = 24;

    /// Returns the square of a number of at most 64 bits.
    #[inline]
    pub(super) fn of(number: i128) -> SquareSum {
        let number = number.unsigned_abs();
        SquareSum { low: number.wrapping_mul(number), high: 0 }
    }

    /// Multiplies by a count.
    #[inline]
    pub(super) fn times(self, count: u64) -> SquareSum {
        let count = u128::from(count);
        let first = (self.low & u128::from(u64::MAX)) * count;
        let second = (self.low >> 64) * count + (first >> 64);
        let low = first & u128::from(u64::MAX) | second << 64;
        SquareSum { low, high: (second >> 64) as u64 + self.high.wrapping_mul(count as u64) }
    }

    /// Whether this can be the sum of the squares of `cells` samples.
    pub(super) fn is_possible(self, cells: u64) -> bool {
        self.high < cells || self == SquareSum::default()
    }

    /// Returns the digits in base 2^64, the lowest first.
    pub(super) fn limbs(self) -> [u64; 3] {
        [self.low as u64, (self.low >> 64) as u64, self.high]
    }

    pub(super) fn to_bytes(self) -> [u8; SquareSum::SIZE] {
        let mut bytes = [0; SquareSum::SIZE];
        bytes[..16].copy_from_slice(&self.low.to_le_bytes());
        bytes[16..].copy_from_slice(&self.high.to_le_bytes());
        bytes
    }

    /// Returns the integer with these bytes, little-endian.
    pub fn from_bytes(bytes: [u8; 24]) -> SquareSum {
        SquareSum {
            low: u128::from_le_bytes(std::array::from_fn(|byte| bytes[byte])),
            high: u64::from_le_bytes(std::array::from_fn(|byte| bytes[16 + byte])),
        }
    }
}

impl Add for SquareSum {
    type Output = SquareSum;

    #[inline]
    fn add(self, other: SquareSum) -> SquareSum {
        let (low, carry) = self.low.overflowing_add(other.low);
        SquareSum { low, high: self.high.wrapping_add(other.high).wrapping_add(u64::from(carry)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_multiply_as_sums_do() {
        for number in [0, 1, 3, i64::MIN.into(), i128::from(u64::MAX), 1 << 40] {
            let square = SquareSum::of(number);
            let mut sum = SquareSum::default();
            for count in 0..70 {
                assert_eq!(square.times(count), sum);
                sum = sum + square;
            }
            let large = square.times((1 << 58) - 1);
            assert_eq!(large + square, square.times(1 << 58));
            assert_eq!(SquareSum::from_bytes(large.to_bytes()), large);
            assert!(large.is_possible(1 << 58));
        }
        assert!(!SquareSum { low: 0, high: 5 }.is_possible(5));
    }
}

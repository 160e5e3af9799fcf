//! Sums and quotients of integers that are wider than the built-in types.

use bnum::cast::As;
use bnum::types::{I1024, U1024};

/// An integer wide enough for all products of sums over faces and powers of a grid's step.
pub(super) type Whole = I1024;

/// A sum of products, modulo 2^192: partial sums may overflow, and the sum is right if its final
/// value fits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct WideSum {
    high: i128,
    low: u64,
}

impl WideSum {
    /// Adds the product of two numbers; the second one must be below 2^62 in magnitude.
    #[inline]
    pub(super) fn add_product(&mut self, a: i128, b: i64) {
        // By halves of the first number: the lower half's product is below 2^126.
        let low = i128::from(self.low) + i128::from(a as u64) * i128::from(b);
        self.low = low as u64;
        self.high = self.high.wrapping_add((low >> 64) + (a >> 64) * i128::from(b));
    }

    pub(super) fn add(&mut self, other: &WideSum) {
        let low = u128::from(self.low) + u128::from(other.low);
        self.low = low as u64;
        self.high = self.high.wrapping_add(other.high).wrapping_add((low >> 64) as i128);
    }

    /// Returns the bytes in two's complement, little-endian.
    pub(crate) fn to_bytes(self) -> [u8; 24] {
        let mut bytes = [0; 24];
        bytes[..8].copy_from_slice(&self.low.to_le_bytes());
        bytes[8..].copy_from_slice(&self.high.to_le_bytes());
        bytes
    }

    pub(crate) fn from_bytes(bytes: [u8; 24]) -> WideSum {
        let [a, b, c] =
            [0, 8, 16].map(|at| u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes")));
        WideSum { low: a, high: (u128::from(b) | u128::from(c) << 64) as i128 }
    }

    pub(super) fn value(&self) -> Whole {
        (whole(self.high) << 64) + whole(i128::from(self.low))
    }
}

pub(super) fn whole(number: i128) -> Whole {
    number.as_()
}

/// Decomposes a positive normal number into an odd integer and the exponent of a power of two.
pub(super) fn odd_part(number: f64) -> (i128, i32) {
    let bits = number.to_bits();
    let digits = (bits & ((1 << 52) - 1)) | 1 << 52;
    let exponent = (bits >> 52 & 0x7ff) as i32 - 1075;
    let zeros = digits.trailing_zeros();
    (i128::from(digits >> zeros), exponent + zeros as i32)
}

/// Returns the double nearest to a quotient times a power of two (ties to even); denormals are
/// rounded twice. The divisor must not be zero, and both must be below 2^900 in magnitude.
pub(super) fn rounded(number: Whole, divisor: Whole, exponent: i32) -> f64 {
    let is_negative = (number < whole(0)) != (divisor < whole(0));
    let (number, divisor) = (number.unsigned_abs(), divisor.unsigned_abs());
    // A quotient of 64 or 65 bits; its last bit is sticky for all that follow.
    let shift = 64 - (number.bit_width() as i32 - divisor.bit_width() as i32);
    let (number, divisor) = if shift >= 0 { (number << shift, divisor) } else { (number, divisor << -shift) };
    let quotient = number / divisor;
    let is_exact: bool = quotient * divisor == number;
    let digits: u128 = (quotient | U1024::from(!is_exact)).as_();
    // In two steps, since a single power of two may be out of range although the result is not.
    let scale = exponent - shift;
    let (half, rest) = (scale / 2, scale - scale / 2);
    let magnitude = digits as f64 * power_of_two(half) * power_of_two(rest);
    if is_negative { -magnitude } else { magnitude }
}

fn power_of_two(exponent: i32) -> f64 {
    2f64.powi(exponent.clamp(-2000, 2000))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotients_are_rounded_as_division_rounds() {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as i128 - (1 << 52)
        };
        for _ in 0..10_000 {
            let (a, b) = (random(), random());
            assert_eq!(rounded(whole(a), whole(b), 0), a as f64 / b as f64, "{a} / {b}");
            assert_eq!(rounded(whole(a), whole(b), -300), a as f64 / b as f64 * 2f64.powi(-300));
            let (odd, exponent) = odd_part(b.unsigned_abs() as f64 * 0.125);
            assert!(odd % 2 == 1 && odd as f64 * 2f64.powi(exponent) == b.unsigned_abs() as f64 * 0.125);
        }
        assert_eq!(rounded(whole(0), whole(5), 0), 0.0);
        // Halfway between two doubles, and slightly more and less.
        let half = (1i128 << 60) + (1 << 7);
        for (number, expected) in [(half, 1i128 << 60), (half + 1, (1 << 60) + (1 << 8)), (half - 1, 1 << 60)]
        {
            assert_eq!(rounded(whole(number), whole(1), 0), expected as f64);
        }
        let third = whole(half) * whole(3) + whole(1);
        assert_eq!(rounded(third, whole(3), 0), ((1i128 << 60) + (1 << 8)) as f64);
    }

    #[test]
    fn sums_of_products_are_those_of_wider_numbers() {
        let mut state = 7u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            state as i64
        };
        let (mut sum, mut parts, mut expected) = (WideSum::default(), [WideSum::default(); 2], whole(0));
        for i in 0..1000 {
            let (a, b) = ((i128::from(random()) << 18) + i128::from(random()), random() >> 2);
            sum.add_product(a, b);
            parts[i % 2].add_product(a, b);
            expected += whole(a) * whole(i128::from(b));
            assert_eq!(sum.value(), expected);
        }
        let [mut first, second] = parts;
        first.add(&second);
        assert_eq!(first.value(), expected);
    }
}

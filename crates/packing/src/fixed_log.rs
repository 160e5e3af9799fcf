//! Logarithms in integer arithmetic, identical on every machine.

/// Fraction bits of a logarithm.
pub const LOG_BITS: u32 = 12;

/// Returns the logarithm of a positive number to base 2, with an error below 0.09: it is
/// interpolated linearly between powers of two. The result is in units of 2^-[`LOG_BITS`].
pub fn log2(number: u64) -> u64 {
    let whole = 63 - number.leading_zeros();
    let fraction = match whole.checked_sub(LOG_BITS) {
        Some(shift) => number >> shift,
        None => number << (LOG_BITS - whole),
    };
    (u64::from(whole) << LOG_BITS) + (fraction & ((1 << LOG_BITS) - 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithms_are_near() {
        for number in (1..5000).chain([u64::MAX, 1 << 40, 3 << 50]) {
            let found = log2(number) as f64 / f64::from(1 << LOG_BITS);
            assert!((found - (number as f64).log2()).abs() < 0.09, "{number}");
        }
    }
}

//! Multiples of decimal steps.

/// Multiples of a step, counted from a base: levels of contours, planes of sections.
///
/// Base and step are taken as their shortest decimals, as the user wrote them: the third multiple
/// of 0.1 is the f64 nearest to 0.3, whereas `3.0 * 0.1` is 0.30000000000000004. Each multiple is
/// rounded once. If base and step together need more than 18 digits, such as 1e9 and 1e-15,
/// multiples are computed with f64 arithmetic instead.
///
/// ```
/// use spinney_base::DecimalSteps;
///
/// let tenths = DecimalSteps::new(0.0, 0.1);
/// assert_eq!((tenths.value(3), tenths.value(-7)), (0.3, -0.7));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct DecimalSteps {
    base: f64,
    step: f64,
    decimals: Option<Decimals>,
}

/// Base and step as integers, in units of `10^-decimals`.
#[derive(Clone, Debug, PartialEq)]
struct Decimals {
    base: i64,
    step: i64,
    decimals: u32,
    /// `10^decimals`, exact up to the 22nd power.
    scale: f64,
}

/// Largest exponent up to which all powers of ten are exact in an f64.
const MAX_EXACT_POWER: u32 = 22;

/// Largest integer up to which all integers are exact in an f64.
const MAX_EXACT: u128 = 1 << f64::MANTISSA_DIGITS;

impl DecimalSteps {
    /// Creates the multiples of `step`, counted from `base`. Both must be finite.
    pub fn new(base: f64, step: f64) -> DecimalSteps {
        DecimalSteps { base, step, decimals: Decimals::new(base, step) }
    }

    /// Returns the base.
    pub fn base(&self) -> f64 {
        self.base
    }

    /// Returns the step.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// Returns the base plus `number` steps.
    ///
    /// Cost: a few nanoseconds, or some hundred if the result has more digits than an f64.
    #[inline]
    pub fn value(&self, number: i64) -> f64 {
        let Some(Decimals { base, step, decimals, scale }) = &self.decimals else {
            return self.base + number as f64 * self.step;
        };
        let sum = i128::from(*base) + i128::from(*step) * i128::from(number);
        if sum.unsigned_abs() <= MAX_EXACT && *decimals <= MAX_EXACT_POWER {
            // Dividend and divisor are exact, so only the division rounds.
            return sum as f64 / scale;
        }
        format!("{sum}e-{decimals}").parse().unwrap_or(f64::NAN)
    }
}

impl Decimals {
    fn new(base: f64, step: f64) -> Option<Decimals> {
        let [base, step] = [digits(base)?, digits(step)?];
        let decimals = base.1.max(step.1);
        // Zero is exact with any number of decimals, so it takes those of the other number.
        let integer = |(digits, own): (i64, u32)| match digits {
            0 => Some(0),
            _ => digits.checked_mul(10i64.checked_pow(decimals - own)?),
        };
        // Parsed, since `powi` may round.
        let scale = format!("1e{}", decimals.min(MAX_EXACT_POWER)).parse().ok()?;
        Some(Decimals { base: integer(base)?, step: integer(step)?, decimals, scale })
    }
}

/// Returns the shortest decimal of a number: its digits as an integer, and how many of them are
/// decimals.
fn digits(number: f64) -> Option<(i64, u32)> {
    let text = format!("{number:e}");
    let (digits, exponent) = text.split_once('e')?;
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let decimals = fraction.len() as i32 - exponent.parse::<i32>().ok()?;
    let digits: i64 = format!("{whole}{fraction}").parse().ok()?;
    match u32::try_from(decimals) {
        Ok(decimals) => Some((digits, decimals)),
        Err(_) => Some((digits.checked_mul(10i64.checked_pow(decimals.unsigned_abs())?)?, 0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Computes a multiple with integer arithmetic. Arguments are digits and their number of
    /// decimals.
    fn expected(base: (i128, usize), step: (i128, usize), number: i64) -> f64 {
        let decimals = base.1.max(step.1);
        let scaled = |(digits, own): (i128, usize)| digits * 10i128.pow((decimals - own) as u32);
        let sum = scaled(base) + scaled(step) * i128::from(number);
        format!("{sum}e-{decimals}").parse().unwrap()
    }

    #[test]
    fn multiples_are_the_decimals_that_are_written() {
        let cases = [
            ((0, 0), (1, 1)),
            ((3, 1), (1, 1)),
            ((-5, 2), (7, 1)),
            ((25, 0), (100, 0)),
            ((0, 0), (1, 22)),
            ((0, 0), (1, 30)),
            ((1, 0), (1234567890123456, 16)),
            ((-27315, 2), (5, 3)),
            ((5, 1), (1_000_000_000_000, 0)),
        ];
        for (base, step) in cases {
            let number = |(digits, decimals)| format!("{digits}e-{decimals}").parse::<f64>().unwrap();
            let steps = DecimalSteps::new(number(base), number(step));
            for count in (-1000..1000).chain([i64::from(i32::MIN), 1 << 40]) {
                let found = steps.value(count);
                assert_eq!(found, expected(base, step, count), "{base:?} {step:?} {count}");
            }
        }
    }

    #[test]
    fn numbers_with_too_many_digits_are_added_as_doubles() {
        for (base, step) in [(1e9, 1e-15), (0.3, 1e-300), (f64::MAX, 1.0), (0.0, f64::MIN_POSITIVE)] {
            let steps = DecimalSteps::new(base, step);
            assert_eq!((steps.value(0), steps.value(3)), (base, base + 3.0 * step), "{base} {step}");
        }
        assert_eq!(DecimalSteps::new(0.0, 1e18).value(5), 5e18);
    }
}

//! Integer grids for coordinates of points and vertices.

/// Extremes and precision of the coordinates along an axis.
#[derive(Clone, Copy, Debug)]
pub struct CoordinateAxis {
    /// Minimum of the coordinates, infinity without any.
    pub least: f64,
    /// Maximum of the coordinates, minus infinity without any.
    pub most: f64,
    /// Maximum number of decimal places; `None` if more than [`MAX_DIGITS`].
    digits: Option<i32>,
    /// Maximum number of binary fraction digits.
    bits: i32,
}

/// Maximum number of decimal places of a decimal grid.
const MAX_DIGITS: i32 = 9;
/// Maximum grid coordinate.
const MAX_STEPS: f64 = (1u64 << 31) as f64 - 1.0;

/// Grid of 32-bit integers along an axis: coordinates are integers times `scale`, plus `offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisGrid {
    /// Size of a grid unit.
    pub scale: f64,
    /// Coordinate of the grid's origin.
    pub offset: f64,
    /// Whether it contains all coordinates; otherwise they are rounded to it.
    pub is_exact: bool,
}

impl CoordinateAxis {
    /// No coordinates.
    pub const NONE: CoordinateAxis =
        CoordinateAxis { least: f64::INFINITY, most: f64::NEG_INFINITY, digits: Some(0), bits: 0 };

    /// Includes a coordinate, which must be finite.
    pub fn include(&mut self, number: f64) {
        self.least = self.least.min(number);
        self.most = self.most.max(number);
        while let Some(digits) = self.digits
            && !has_digits(number, digits)
        {
            self.digits = Some(digits + 1).filter(|digits| *digits <= MAX_DIGITS);
        }
        self.bits = self.bits.max(fraction_bits(number));
    }

    /// Returns the offset of a grid of this scale that spans the coordinates; `None` if there is
    /// none. It is an integer, so that grid units stay aligned with the coordinates.
    pub fn offset(&self, scale: f64) -> Option<f64> {
        let reach = self.least.abs().max(self.most.abs());
        let offset = if reach / scale <= MAX_STEPS { 0.0 } else { self.least.floor() };
        ((self.most - offset) / scale <= MAX_STEPS).then_some(offset)
    }

    /// Returns a grid that contains all coordinates exactly, of their decimal places if they are
    /// few, else of their binary digits; or else the finest grid that spans them.
    pub fn grid(&self) -> AxisGrid {
        if self.least > self.most {
            return AxisGrid { scale: 1.0, offset: 0.0, is_exact: true };
        }
        let decimal = self.digits.map(|digits| 10f64.powi(-digits));
        let binary = (self.bits <= 40).then(|| 2f64.powi(-self.bits));
        for scale in [decimal, binary].into_iter().flatten() {
            if let Some(offset) = self.offset(scale) {
                return AxisGrid { scale, offset, is_exact: true };
            }
        }
        let mut powers = (-40..=1023).map(|power| 2f64.powi(power));
        let found = powers.find_map(|scale| Some((scale, self.offset(scale)?)));
        let (scale, offset) = found.unwrap_or((f64::MAX, 0.0));
        AxisGrid { scale, offset, is_exact: false }
    }
}

/// Returns whether a number has at most `digits` decimal places, within double precision.
fn has_digits(number: f64, digits: i32) -> bool {
    let steps = number * 10f64.powi(digits);
    (steps - steps.round()).abs() <= steps.abs() * 4.0 * f64::EPSILON
}

/// Returns the number of binary fraction digits of a number.
fn fraction_bits(number: f64) -> i32 {
    if number == 0.0 {
        return 0;
    }
    let bits = number.to_bits();
    let (exponent, fraction) = ((bits >> 52 & 0x7ff) as i32, bits & ((1 << 52) - 1));
    let zeros = if fraction == 0 { 52 } else { fraction.trailing_zeros() as i32 };
    (1075 - exponent.max(1) - zeros).max(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(numbers: &[f64]) -> (f64, f64, bool) {
        let mut axis = CoordinateAxis::NONE;
        numbers.iter().for_each(|number| axis.include(*number));
        let AxisGrid { scale, offset, is_exact } = axis.grid();
        (scale, offset, is_exact)
    }

    #[test]
    fn grids_are_those_of_digits_or_bits() {
        assert_eq!(grid(&[]), (1.0, 0.0, true));
        assert_eq!(grid(&[500_000.123, 500_001.5, -3.0]), (0.001, 0.0, true));
        assert_eq!(grid(&[5_200_000.123_4, 5_200_001.5]), (0.000_1, 5_200_000.0, true));
        assert_eq!(grid(&[-179.123_456_7, 179.0]), (1e-7, 0.0, true));
        assert_eq!(grid(&[0.1f32.into(), 0.7f32.into()]), (2f64.powi(-27), 0.0, true));
        let (scale, _, has_all) = grid(&[std::f64::consts::PI, 1000.0]);
        assert!(!has_all && scale <= 1000.0 / 2f64.powi(30), "{scale}");
        let (scale, offset, _) = grid(&[-1e300, 1e300]);
        assert!(2e300 / scale <= 2f64.powi(32) && offset <= 0.0);
        assert_eq!(grid(&[7.0, 7.0]), (1.0, 0.0, true));
        assert_eq!(
            (fraction_bits(0.375), fraction_bits(-3.0), fraction_bits(f64::MIN_POSITIVE / 2.0)),
            (3, 0, 1023)
        );
    }
}

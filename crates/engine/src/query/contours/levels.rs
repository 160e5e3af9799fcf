//! Values that contour lines are drawn at.

use spinney_base::{DecimalSteps, Error, Result, sort};

/// Values that contour lines are drawn at.
#[derive(Clone, Debug, PartialEq)]
pub enum ContourLevels {
    /// All multiples of a step, counted from a base: see [`DecimalSteps`].
    Every {
        /// Distance between adjacent levels, greater than 0.
        step: f64,
        /// One of the levels.
        base: f64,
    },
    /// These values, in any order.
    At(Vec<f64>),
}

/// Approximate limit of the absolute values of level numbers, whatever the values are.
const MAX_LEVEL_NUMBER: i32 = 1 << 30;

/// Levels, numbered upwards. A value's *rank* is the number of the first level above it: the level
/// of number `n` is at most the value exactly if the rank is greater than `n`. All decisions about
/// lines are based on ranks, so they cannot contradict each other.
#[derive(Debug)]
pub struct Levels(Kind);

#[derive(Debug)]
enum Kind {
    Every(DecimalSteps),
    /// Ascending.
    At(Vec<f64>),
}

impl Levels {
    /// Checks and sorts levels.
    ///
    /// # Errors
    /// If there are none, a level is not finite, or the step is not greater than 0.
    pub fn new(levels: &ContourLevels) -> Result<Levels> {
        let invalid = |found: String, expected: &str| Err(Error::invalid("contour levels", found, expected));
        match levels {
            ContourLevels::Every { step, base } => {
                if !(*step > 0.0 && step.is_finite() && base.is_finite()) {
                    return invalid(
                        format!("step {step} from base {base}"),
                        "a finite base and a finite step above 0",
                    );
                }
                Ok(Levels(Kind::Every(DecimalSteps::new(*base, *step))))
            }
            ContourLevels::At(values) => {
                if let Some(value) = values.iter().find(|value| !value.is_finite()) {
                    return invalid(value.to_string(), "finite numbers");
                }
                if values.is_empty() || values.len() > MAX_LEVEL_NUMBER as usize {
                    return invalid(
                        format!("{} levels", values.len()),
                        &format!("1 to {MAX_LEVEL_NUMBER} levels"),
                    );
                }
                let mut values = values.clone();
                sort::floats(&mut values);
                // (Zero has two signs.)
                values.dedup_by(|a, b| a == b);
                Ok(Levels(Kind::At(values)))
            }
        }
    }

    /// Returns levels in ascending order: all levels of a list, or the multiples of a step that lie
    /// between the values.
    ///
    /// # Errors
    /// If there are too many.
    pub fn reached(&self, (min, max): (f64, f64)) -> Result<Vec<f64>> {
        const MAX_REACHED: i32 = 1 << 16;
        let numbers = match &self.0 {
            Kind::Every(_) => self.rank(min)..self.rank(max),
            Kind::At(values) => 0..values.len() as i32,
        };
        if numbers.end.saturating_sub(numbers.start) > MAX_REACHED {
            let found = format!("more than {MAX_REACHED} levels");
            return Err(Error::invalid("contour levels", found, "fewer levels"));
        }
        Ok(numbers.map(|number| self.value(number)).collect())
    }

    /// Returns the level of a number.
    pub(super) fn value(&self, number: i32) -> f64 {
        match &self.0 {
            Kind::Every(steps) => steps.value(number.into()),
            Kind::At(values) => {
                let last = values.len().saturating_sub(1);
                values.get((number.max(0) as usize).min(last)).copied().unwrap_or(0.0)
            }
        }
    }

    /// Returns the rank of a value, which must not be NaN.
    #[inline]
    pub(super) fn rank(&self, value: f64) -> i32 {
        match &self.0 {
            Kind::Every(steps) => {
                let guess = ((value - steps.base()) / steps.step())
                    .floor()
                    .clamp(f64::from(-MAX_LEVEL_NUMBER), f64::from(MAX_LEVEL_NUMBER))
                    as i32;
                // Levels are rounded, so the guess may be off by one.
                let is_reached = |number: i32| self.value(number) <= value;
                if is_reached(guess + 1) {
                    guess + 2
                } else if is_reached(guess) {
                    guess + 1
                } else {
                    guess
                }
            }
            Kind::At(values) => values.partition_point(|level| *level <= value) as i32,
        }
    }

    /// Returns minimum and maximum value of the band of a rank, between two adjacent levels. A band
    /// without a level at an end extends to the minimum or maximum of all values.
    pub(super) fn band(&self, rank: i32, (min, max): (f64, f64)) -> [f64; 2] {
        match &self.0 {
            Kind::Every(_) => [self.value(rank - 1), self.value(rank)],
            Kind::At(values) => [
                if rank <= 0 { min } else { self.value(rank - 1) },
                if rank as usize >= values.len() { max } else { self.value(rank) },
            ],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_agree_with_levels() {
        for levels in [
            ContourLevels::Every { step: 0.1, base: 0.3 },
            ContourLevels::Every { step: 100.0, base: 0.0 },
            ContourLevels::At(vec![3.0, -0.0, 0.0, 7.5, 3.0]),
        ] {
            let levels = Levels::new(&levels).unwrap();
            for number in 0..3 {
                let level = levels.value(number);
                assert_eq!(levels.rank(level), number + 1);
                assert_eq!(levels.rank(level.next_down()), number);
                assert_eq!(levels.rank(level.next_up()), number + 1);
            }
        }
        let tenths = Levels::new(&ContourLevels::Every { step: 0.1, base: 0.0 }).unwrap();
        assert_eq!((tenths.rank(0.3), tenths.value(3)), (4, 0.3));
        let levels = Levels::new(&ContourLevels::Every { step: 1e-300, base: 0.0 }).unwrap();
        assert_eq!(levels.rank(1e300), MAX_LEVEL_NUMBER + 2);
        for levels in [
            ContourLevels::At(vec![]),
            ContourLevels::At(vec![f64::NAN]),
            ContourLevels::Every { step: 0.0, base: 0.0 },
            ContourLevels::Every { step: 1.0, base: f64::INFINITY },
        ] {
            assert!(Levels::new(&levels).is_err(), "{levels:?}");
        }
    }
}

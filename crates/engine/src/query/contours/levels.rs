//! The values that lines are drawn at.

use spinney_base::{DecimalSteps, Error, Result, sort};

/// The values that contour lines are drawn at.
#[derive(Clone, Debug, PartialEq)]
pub enum ContourLevels {
    /// All multiples of a step, counted from a base: see [`DecimalSteps`].
    Every {
        /// Distance between neighbours, greater than 0.
        step: f64,
        /// One of the values.
        base: f64,
    },
    /// These, in any order.
    At(Vec<f64>),
}

/// Numbers of levels stay within these, whatever the values are.
const MOST: i32 = 1 << 30;

/// Levels, numbered upwards: a value's *rank* is the number of the first level above it, so that the level of number `n` is at most the value
/// exactly if the rank is greater than `n`. All decisions about lines are made on ranks, so that none contradicts another.
#[derive(Debug)]
pub struct Levels(Kind);

#[derive(Debug)]
enum Kind {
    Every(DecimalSteps),
    /// In ascending order.
    At(Vec<f64>),
}

impl Levels {
    /// Checks levels and puts them in order.
    ///
    /// # Errors
    /// If there are none, one is no finite number, or the step is not greater than 0.
    pub fn new(levels: &ContourLevels) -> Result<Levels> {
        let invalid = |found: String, expected: &str| Err(Error::invalid("contour levels", found, expected));
        match levels {
            ContourLevels::Every { step, base } => {
                if !(*step > 0.0 && step.is_finite() && base.is_finite()) {
                    return invalid(
                        format!("every {step} from {base}"),
                        "a finite base, and a finite step above 0",
                    );
                }
                Ok(Levels(Kind::Every(DecimalSteps::new(*base, *step))))
            }
            ContourLevels::At(values) => {
                if let Some(value) = values.iter().find(|value| !value.is_finite()) {
                    return invalid(value.to_string(), "finite numbers");
                }
                if values.is_empty() || values.len() > MOST as usize {
                    return invalid(format!("{} levels", values.len()), "at least one");
                }
                let mut values = values.clone();
                sort::floats(&mut values);
                // (Zero has two signs.)
                values.dedup_by(|a, b| a == b);
                Ok(Levels(Kind::At(values)))
            }
        }
    }

    /// The levels, from the lowest on: all that were given; of multiples of a step those that only some of all values reach.
    ///
    /// # Errors
    /// If there are far too many.
    pub fn reached(&self, (least, greatest): (f64, f64)) -> Result<Vec<f64>> {
        const MAX_REACHED: i32 = 1 << 16;
        let numbers = match &self.0 {
            Kind::Every(_) => self.rank(least)..self.rank(greatest),
            Kind::At(values) => 0..values.len() as i32,
        };
        if numbers.end.saturating_sub(numbers.start) > MAX_REACHED {
            let found = format!("more than {MAX_REACHED} of them");
            return Err(Error::invalid("contour levels", found, "levels farther apart"));
        }
        Ok(numbers.map(|number| self.value(number)).collect())
    }

    /// The level of a number.
    pub(super) fn value(&self, number: i32) -> f64 {
        match &self.0 {
            Kind::Every(steps) => steps.value(number.into()),
            Kind::At(values) => {
                let last = values.len().saturating_sub(1);
                values.get((number.max(0) as usize).min(last)).copied().unwrap_or(0.0)
            }
        }
    }

    /// The rank of a value, which is a number.
    #[inline]
    pub(super) fn rank(&self, value: f64) -> i32 {
        match &self.0 {
            Kind::Every(steps) => {
                let guess = ((value - steps.base()) / steps.step())
                    .floor()
                    .clamp(f64::from(-MOST), f64::from(MOST)) as i32;
                // The levels are as they are rounded: the guess may be off by one.
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

    /// Least and greatest value of the band between two neighbouring levels that values of a rank lie in; one without a level at an end
    /// ends where all values do.
    pub(super) fn band(&self, rank: i32, (least, greatest): (f64, f64)) -> [f64; 2] {
        match &self.0 {
            Kind::Every(_) => [self.value(rank - 1), self.value(rank)],
            Kind::At(values) => [
                if rank <= 0 { least } else { self.value(rank - 1) },
                if rank as usize >= values.len() { greatest } else { self.value(rank) },
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
        assert_eq!(levels.rank(1e300), MOST + 2);
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

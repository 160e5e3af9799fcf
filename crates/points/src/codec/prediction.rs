//! What a number of a column is likely to be, from the points before.

/// Ways to foretell the numbers of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Prediction {
    /// Zero.
    Nothing = 0,
    /// The number before.
    Last = 1,
    /// Where a straight line through the numbers before leads, by the clock.
    Line = 2,
    /// The mean of the numbers before.
    Mean = 3,
}

impl Prediction {
    pub(crate) const ALL: [Prediction; 4] =
        [Prediction::Nothing, Prediction::Last, Prediction::Line, Prediction::Mean];
}

/// The time from point to point: by a column that is a clock, or the same everywhere.
pub(crate) struct Clock {
    /// Time since the point before; nothing if there is no clock.
    steps: Vec<f64>,
    /// 1 for points at the time of the one before, 0 for others; nothing if there is no clock.
    pub(crate) contexts: Vec<u8>,
}

impl Clock {
    /// The clock of a column; none if there is no such column.
    pub(crate) fn new(times: Option<&[i64]>) -> Clock {
        let times = times.unwrap_or_default();
        let befores = times.first().into_iter().chain(times);
        let steps: Vec<f64> =
            times.iter().zip(befores).map(|(time, before)| time.wrapping_sub(*before) as f64).collect();
        let contexts = steps.iter().map(|step| u8::from(*step == 0.0)).collect();
        Clock { steps, contexts }
    }

    #[inline]
    fn step(&self, point: usize) -> f64 {
        self.steps.get(point).copied().unwrap_or(1.0)
    }
}

/// A straight line through the last numbers of a column, fitted by least squares in which each number counts 7/8 of the one behind it.
///
/// Sums are kept about the last point, whose time and number are 0. All of it is IEEE arithmetic in this order, so that whoever reads comes to
/// the same numbers.
#[derive(Default)]
struct Line {
    weight: f64,
    times: f64,
    squares: f64,
    numbers: f64,
    products: f64,
}

/// How much a point still counts when the next one has come.
const FADES: f64 = 0.875;
/// A step in time of more than so many times the spread of the times before tells nothing.
const FAR: f64 = 8.0;

impl Line {
    /// How much the number will differ from the last one, after so much time.
    #[inline]
    fn foretell(&self, step: f64) -> f64 {
        let spread = self.weight * self.squares - self.times * self.times;
        if step == 0.0 || spread <= 0.0 || step * step * self.weight > FAR * FAR * self.squares {
            return 0.0;
        }
        let slope = (self.weight * self.products - self.times * self.numbers) / spread;
        let here = (self.numbers - slope * self.times) / self.weight;
        here + slope * step
    }

    /// Adds a point, after so much time, whose number differs by so much from the last one.
    #[inline]
    fn add(&mut self, step: f64, change: f64) {
        if step * step * self.weight > FAR * FAR * self.squares && self.squares > 0.0 {
            *self = Line::default();
        }
        // To the new point: all others are earlier by the step, and less by the change.
        self.products =
            self.products - step * self.numbers - change * self.times + step * change * self.weight;
        self.squares = self.squares - 2.0 * step * self.times + step * step * self.weight;
        self.times -= step * self.weight;
        self.numbers -= change * self.weight;
        self.weight = self.weight * FADES + 1.0;
        self.times *= FADES;
        self.squares *= FADES;
        self.numbers *= FADES;
        self.products *= FADES;
    }
}

/// A prediction as a whole number.
#[inline]
fn whole(number: f64) -> i64 {
    // (Saturating, and 0 for what is no number. `floor` would be a call where nobody asks for a newer processor.)
    let number = number + 0.5;
    let cut = number as i64;
    cut.wrapping_sub(i64::from(cut as f64 > number))
}

/// The mean of the last numbers of a column, in which each number counts 15/16 of the one behind it; about the last one.
#[derive(Default)]
struct Mean {
    weight: f64,
    numbers: f64,
}

impl Mean {
    #[inline]
    fn foretell(&self) -> f64 {
        self.numbers / self.weight
    }

    #[inline]
    fn add(&mut self, change: f64) {
        self.numbers = (self.numbers - change * self.weight) * SLOWLY_FADES;
        self.weight = self.weight * SLOWLY_FADES + 1.0;
    }
}

/// How much a number still counts in a mean when the next one has come.
const SLOWLY_FADES: f64 = 0.9375;

/// Goes from number to number: `next` gets how much one is foretold to differ from the one before, and tells how much it does.
#[inline(always)]
fn follow(count: usize, clock: &Clock, prediction: Prediction, mut next: impl FnMut(usize, i64) -> i64) {
    match prediction {
        Prediction::Nothing | Prediction::Last => (0..count).for_each(|point| {
            next(point, 0);
        }),
        Prediction::Line => {
            let mut line = Line::default();
            for point in 0..count {
                let step = if point == 0 { 0.0 } else { clock.step(point) };
                let change = next(point, whole(line.foretell(step)));
                line.add(step, if point == 0 { 0.0 } else { change as f64 });
            }
        }
        Prediction::Mean => {
            let mut mean = Mean::default();
            for point in 0..count {
                let change = next(point, if point == 0 { 0 } else { whole(mean.foretell()) });
                mean.add(if point == 0 { 0.0 } else { change as f64 });
            }
        }
    }
}

/// Puts what numbers differ from what was foretold into `errors`.
pub(crate) fn errors_of(numbers: &[i64], clock: &Clock, prediction: Prediction, errors: &mut Vec<i64>) {
    errors.clear();
    if prediction == Prediction::Nothing {
        return errors.extend_from_slice(numbers);
    }
    let mut last = 0i64;
    follow(numbers.len(), clock, prediction, |point, foretold| {
        let change = numbers[point].wrapping_sub(last);
        last = numbers[point];
        errors.push(change.wrapping_sub(foretold));
        change
    });
}

/// Makes numbers of their errors, in place.
pub(crate) fn numbers_of(errors: &mut [i64], clock: &Clock, prediction: Prediction) {
    if prediction == Prediction::Nothing {
        return;
    }
    let mut last = 0i64;
    follow(errors.len(), clock, prediction, |point, foretold| {
        let change = errors[point].wrapping_add(foretold);
        last = last.wrapping_add(change);
        errors[point] = last;
        change
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_back_from_their_errors() {
        let mut state = 3u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as i64
        };
        let times: Vec<i64> = (0..3000)
            .scan(0, |time, _| {
                *time += [0, 1, 1, 2, 40, 1 << 40][random() as usize % 6];
                Some(*time)
            })
            .collect();
        let columns: [Vec<i64>; 3] = [
            times.iter().map(|time| time * 3 + random() % 5).collect(),
            (0..3000).map(|_| random() << 33 | random()).collect(),
            (0..3000).map(|at| if at % 7 == 0 { i64::MIN } else { i64::MAX }).collect(),
        ];
        for clock in [Clock::new(None), Clock::new(Some(&times))] {
            for column in &columns {
                for prediction in Prediction::ALL {
                    let mut errors = Vec::new();
                    errors_of(column, &clock, prediction, &mut errors);
                    numbers_of(&mut errors, &clock, prediction);
                    assert!(&errors == column, "{prediction:?}");
                }
            }
        }
    }

    #[test]
    fn what_moves_evenly_is_foretold() {
        let times: Vec<i64> = (0..1000)
            .scan(0, |time, at| {
                *time += 1 + at % 3;
                Some(*time)
            })
            .collect();
        let numbers: Vec<i64> = times.iter().map(|time| 500 - 17 * time).collect();
        let mut errors = Vec::new();
        errors_of(&numbers, &Clock::new(Some(&times)), Prediction::Line, &mut errors);
        assert!(errors[3..].iter().all(|error| error.abs() <= 1), "{:?}", &errors[..20]);
    }
}

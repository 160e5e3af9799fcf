//! Prediction of a column's numbers from the preceding points.

/// Predictors of a column's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Prediction {
    /// Zero.
    Nothing = 0,
    /// The previous number.
    Last = 1,
    /// Extrapolation of a straight line through the preceding numbers, by the clock.
    Line = 2,
    /// The mean of the preceding numbers.
    Mean = 3,
}

impl Prediction {
    pub(crate) const ALL: [Prediction; 4] =
        [Prediction::Nothing, Prediction::Last, Prediction::Line, Prediction::Mean];
}

/// Time differences between points, from a clock column; without one, they are all equal.
pub(crate) struct Clock {
    /// Time since the previous point; empty without a clock.
    steps: Vec<f64>,
    /// 1 for points with the time of the previous one, 0 for others; empty without a clock.
    pub(crate) contexts: Vec<u8>,
    /// Time-dependent terms of the line fits, shared by all columns; computed when first needed.
    line_terms: Vec<LineTerms>,
}

impl Clock {
    /// Creates the clock of a column; without a column, it is empty.
    pub(crate) fn new(times: Option<&[i64]>) -> Clock {
        let times = times.unwrap_or_default();
        let befores = times.first().into_iter().chain(times);
        let steps: Vec<f64> =
            times.iter().zip(befores).map(|(time, before)| time.wrapping_sub(*before) as f64).collect();
        let contexts = steps.iter().map(|step| u8::from(*step == 0.0)).collect();
        Clock { steps, contexts, line_terms: Vec::new() }
    }

    /// Returns the time-dependent terms of the first points, which all columns share.
    fn line_terms(&mut self, points: usize) -> &[LineTerms] {
        if self.line_terms.len() < points {
            let steps =
                (0..points).map(|point| self.steps.get(point).copied().unwrap_or(f64::from(point > 0)));
            let mut line = Times::default();
            self.line_terms = steps.map(|step| line.next(step)).collect();
        }
        &self.line_terms
    }
}

/// Weight of a point relative to the next one.
const FADES: f64 = 0.875;
/// A time difference above this multiple of the spread of the preceding times makes a prediction
/// useless.
const FAR: f64 = 8.0;

/// Time-dependent sums of a least-squares line fit to the last numbers of a column. They are the
/// same for all columns. Weights fade exponentially: each number has 7/8 of the weight of its
/// successor.
///
/// The sums are relative to the last point, whose time and number are 0. All of this is IEEE
/// arithmetic in a fixed order, so that encoder and decoder compute identical numbers.
#[derive(Default)]
struct Times {
    weight: f64,
    times: f64,
    squares: f64,
}

/// Terms for predicting one point: its time difference, the sums of weights and times of the
/// preceding points (0 at a start), and reciprocals of their divisors.
struct LineTerms {
    step: f64,
    weight: f64,
    times: f64,
    /// Reciprocal of the spread of the times; 0 where a line predicts nothing.
    by_spread: f64,
    by_weight: f64,
}

impl Times {
    /// Advances to a point, by the time since the previous one.
    fn next(&mut self, step: f64) -> LineTerms {
        let is_far = step * step * self.weight > FAR * FAR * self.squares;
        if is_far && self.squares > 0.0 {
            *self = Times::default();
        }
        let Times { weight, times, squares } = *self;
        let spread = weight * squares - times * times;
        let is_defined = step != 0.0 && spread > 0.0 && !is_far;
        let by_spread = if is_defined { 1.0 / spread } else { 0.0 };
        // Move the origin to the new point: all others are now earlier by the time difference.
        self.squares = (squares - 2.0 * step * times + step * step * weight) * FADES;
        self.times = (times - step * weight) * FADES;
        self.weight = weight * FADES + 1.0;
        LineTerms { step, weight, times, by_spread, by_weight: if weight > 0.0 { 1.0 / weight } else { 0.0 } }
    }
}

/// Line fit to the last numbers of one column: sums of the numbers and of their products with the
/// times.
#[derive(Default)]
struct Line {
    numbers: f64,
    products: f64,
}

impl Line {
    /// Predicts the difference between a point's number and the last one.
    #[inline]
    fn predict(&self, terms: &LineTerms) -> f64 {
        if terms.by_spread == 0.0 {
            return 0.0;
        }
        let slope = (terms.weight * self.products - terms.times * self.numbers) * terms.by_spread;
        (self.numbers - slope * terms.times) * terms.by_weight + slope * terms.step
    }

    /// Adds a point's number, given its difference to the last one.
    #[inline]
    fn add(&mut self, terms: &LineTerms, change: f64) {
        if terms.weight == 0.0 {
            *self = Line::default();
            return;
        }
        // Move the origin to the new point: all others are now earlier by the time difference, and
        // lower by the change.
        let products = self.products - terms.step * self.numbers - change * terms.times
            + terms.step * change * terms.weight;
        self.products = products * FADES;
        self.numbers = (self.numbers - change * terms.weight) * FADES;
    }
}

/// Rounds a prediction to an integer.
#[inline]
fn whole(number: f64) -> i64 {
    // The cast saturates, and maps NaN to 0. `floor` would be a function call on baseline
    // processors.
    let number = number + 0.5;
    let cut = number as i64;
    cut.wrapping_sub(i64::from(cut as f64 > number))
}

/// Mean of the last numbers of a column, relative to the last one. Each number has 15/16 of the
/// weight of its successor.
#[derive(Default)]
struct Mean {
    weight: f64,
    numbers: f64,
}

impl Mean {
    #[inline]
    fn predict(&self) -> f64 {
        self.numbers / self.weight
    }

    #[inline]
    fn add(&mut self, change: f64) {
        self.numbers = (self.numbers - change * self.weight) * SLOWLY_FADES;
        self.weight = self.weight * SLOWLY_FADES + 1.0;
    }
}

/// Weight of a number in a mean, relative to the next one.
const SLOWLY_FADES: f64 = 0.9375;

/// Iterates over the numbers. `next` takes the predicted difference to the previous number and
/// returns the actual one.
#[inline(always)]
fn follow(count: usize, clock: &mut Clock, prediction: Prediction, mut next: impl FnMut(usize, i64) -> i64) {
    match prediction {
        Prediction::Nothing | Prediction::Last => (0..count).for_each(|point| {
            next(point, 0);
        }),
        Prediction::Line => {
            let mut line = Line::default();
            for (point, terms) in clock.line_terms(count)[..count].iter().enumerate() {
                let change = next(point, whole(line.predict(terms)));
                line.add(terms, change as f64);
            }
        }
        Prediction::Mean => {
            let mut mean = Mean::default();
            for point in 0..count {
                let change = next(point, if point == 0 { 0 } else { whole(mean.predict()) });
                mean.add(if point == 0 { 0.0 } else { change as f64 });
            }
        }
    }
}

/// Writes the prediction errors of numbers into `errors`.
pub(crate) fn errors_of(numbers: &[i64], clock: &mut Clock, prediction: Prediction, errors: &mut Vec<i64>) {
    errors.clear();
    if prediction == Prediction::Nothing {
        return errors.extend_from_slice(numbers);
    }
    errors.resize(numbers.len(), 0);
    let mut last = 0i64;
    follow(numbers.len(), clock, prediction, |point, predicted| {
        let change = numbers[point].wrapping_sub(last);
        last = numbers[point];
        errors[point] = change.wrapping_sub(predicted);
        change
    });
}

/// Replaces prediction errors by the numbers, in place.
pub(crate) fn numbers_of(errors: &mut [i64], clock: &mut Clock, prediction: Prediction) {
    if prediction == Prediction::Nothing {
        return;
    }
    let mut last = 0i64;
    follow(errors.len(), clock, prediction, |point, predicted| {
        let change = errors[point].wrapping_add(predicted);
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
        for mut clock in [Clock::new(None), Clock::new(Some(&times))] {
            for column in &columns {
                for prediction in Prediction::ALL {
                    let mut errors = Vec::new();
                    errors_of(column, &mut clock, prediction, &mut errors);
                    numbers_of(&mut errors, &mut clock, prediction);
                    assert!(&errors == column, "{prediction:?}");
                }
            }
        }
    }

    #[test]
    fn linear_motion_is_predicted() {
        let times: Vec<i64> = (0..1000)
            .scan(0, |time, at| {
                *time += 1 + at % 3;
                Some(*time)
            })
            .collect();
        let numbers: Vec<i64> = times.iter().map(|time| 500 - 17 * time).collect();
        let mut errors = Vec::new();
        errors_of(&numbers, &mut Clock::new(Some(&times)), Prediction::Line, &mut errors);
        assert!(errors[3..].iter().all(|error| error.abs() <= 1), "{:?}", &errors[..20]);
    }
}

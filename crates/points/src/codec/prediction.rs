//! Predictions of the numbers of a column, from the points before.

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
    /// Time since the point before, for each; nothing if there is no clock.
    steps: Vec<f64>,
    /// 1 for points at the time of the one before, 0 for others; nothing if there is no clock.
    pub(crate) contexts: Vec<u8>,
    /// The part of lines that all columns share, for each point; nothing before somebody asks for it.
    ways: Vec<Way>,
}

impl Clock {
    /// The clock of a column; none if there is no such column.
    pub(crate) fn new(times: Option<&[i64]>) -> Clock {
        let times = times.unwrap_or_default();
        let befores = times.first().into_iter().chain(times);
        let steps: Vec<f64> =
            times.iter().zip(befores).map(|(time, before)| time.wrapping_sub(*before) as f64).collect();
        let contexts = steps.iter().map(|step| u8::from(*step == 0.0)).collect();
        Clock { steps, contexts, ways: Vec::new() }
    }

    /// The part of lines that all columns share, for so many points.
    fn ways(&mut self, points: usize) -> &[Way] {
        if self.ways.len() < points {
            let steps =
                (0..points).map(|point| self.steps.get(point).copied().unwrap_or(f64::from(point > 0)));
            let mut line = Times::default();
            self.ways = steps.map(|step| line.next(step)).collect();
        }
        &self.ways
    }
}

/// How much a point still counts when the next one has come.
const FADES: f64 = 0.875;
/// A step in time of more than so many times the spread of the times before tells nothing.
const FAR: f64 = 8.0;

/// Sums for fitting a straight line through the last numbers of a column by least squares, in which each number counts 7/8 of the one behind it: the part that
/// the times alone tell, which is the same for all columns.
///
/// Sums are kept about the last point, whose time and number are 0. All of it is IEEE arithmetic in this order, so that whoever reads comes to
/// the same numbers.
#[derive(Default)]
struct Times {
    weight: f64,
    times: f64,
    squares: f64,
}

/// The times before a point: its step, the sums of weights and times (0 at a beginning), and what their sums of products are divided by.
struct Way {
    step: f64,
    weight: f64,
    times: f64,
    /// One by the spread of the times; 0 where a line would tell nothing.
    by_spread: f64,
    by_weight: f64,
}

impl Times {
    /// Goes on to a point, after so much time.
    fn next(&mut self, step: f64) -> Way {
        let is_far = step * step * self.weight > FAR * FAR * self.squares;
        if is_far && self.squares > 0.0 {
            *self = Times::default();
        }
        let Times { weight, times, squares } = *self;
        let spread = weight * squares - times * times;
        let tells = step != 0.0 && spread > 0.0 && !is_far;
        let by_spread = if tells { 1.0 / spread } else { 0.0 };
        // To the new point: all others are earlier by the step.
        self.squares = (squares - 2.0 * step * times + step * step * weight) * FADES;
        self.times = (times - step * weight) * FADES;
        self.weight = weight * FADES + 1.0;
        Way { step, weight, times, by_spread, by_weight: if weight > 0.0 { 1.0 / weight } else { 0.0 } }
    }
}

/// A straight line through the last numbers of one column: sums of the numbers, and of their products with the times.
#[derive(Default)]
struct Line {
    numbers: f64,
    products: f64,
}

impl Line {
    /// How much the number at a point will differ from the last one.
    #[inline]
    fn foretell(&self, way: &Way) -> f64 {
        if way.by_spread == 0.0 {
            return 0.0;
        }
        let slope = (way.weight * self.products - way.times * self.numbers) * way.by_spread;
        (self.numbers - slope * way.times) * way.by_weight + slope * way.step
    }

    /// Adds the number of a point, which differs by so much from the last one.
    #[inline]
    fn add(&mut self, way: &Way, change: f64) {
        if way.weight == 0.0 {
            *self = Line::default();
            return;
        }
        // To the new point: all others are earlier by the step, and less by the change.
        let products =
            self.products - way.step * self.numbers - change * way.times + way.step * change * way.weight;
        self.products = products * FADES;
        self.numbers = (self.numbers - change * way.weight) * FADES;
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
fn follow(count: usize, clock: &mut Clock, prediction: Prediction, mut next: impl FnMut(usize, i64) -> i64) {
    match prediction {
        Prediction::Nothing | Prediction::Last => (0..count).for_each(|point| {
            next(point, 0);
        }),
        Prediction::Line => {
            let mut line = Line::default();
            for (point, way) in clock.ways(count)[..count].iter().enumerate() {
                let change = next(point, whole(line.foretell(way)));
                line.add(way, change as f64);
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
pub(crate) fn errors_of(numbers: &[i64], clock: &mut Clock, prediction: Prediction, errors: &mut Vec<i64>) {
    errors.clear();
    if prediction == Prediction::Nothing {
        return errors.extend_from_slice(numbers);
    }
    errors.resize(numbers.len(), 0);
    let mut last = 0i64;
    follow(numbers.len(), clock, prediction, |point, foretold| {
        let change = numbers[point].wrapping_sub(last);
        last = numbers[point];
        errors[point] = change.wrapping_sub(foretold);
        change
    });
}

/// Makes numbers of their errors, in place.
pub(crate) fn numbers_of(errors: &mut [i64], clock: &mut Clock, prediction: Prediction) {
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
    fn what_moves_evenly_is_foretold() {
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

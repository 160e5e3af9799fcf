//! Colour scales: stops, and interpolation between them.

use super::layer::Interpolation;

/// A colour ramp whose stops are numbers.
#[derive(Clone, Debug)]
pub(super) struct Scale {
    /// In ascending order.
    stops: Vec<f64>,
    colours: Vec<[u8; 4]>,
    /// For each stop, the reciprocal of half the distance to the next one; empty without
    /// interpolation.
    inverse: Vec<f64>,
    /// Search index: for each of `PARTS` equal parts of the range, the last stop in an earlier
    /// part.
    first: Vec<u16>,
    least: f64,
    parts_per_unit: f64,
}

/// Number of parts of the search index. With several per stop, a search takes one or two
/// iterations.
const PARTS: usize = 1024;

impl Scale {
    /// Creates a scale from ascending stops: at least one, at most 65536.
    pub(super) fn new(stops: &[(f64, [u8; 4])], interpolation: Interpolation) -> Scale {
        let colours: Vec<[u8; 4]> = stops.iter().map(|stop| stop.1).collect();
        let mut stops: Vec<f64> = stops.iter().map(|stop| stop.0).collect();
        if interpolation == Interpolation::Nearest {
            // The colour of a stop begins halfway from the previous stop.
            for i in (1..stops.len()).rev() {
                stops[i] = stops[i - 1].midpoint(stops[i]);
            }
        }
        // Halve first: the difference of two numbers may overflow.
        let distance = |pair: &[f64]| 1.0 / (pair[1] / 2.0 - pair[0] / 2.0);
        let inverse = match interpolation {
            Interpolation::Linear => stops.windows(2).map(distance).collect(),
            _ => Vec::new(),
        };
        let (least, most) = (stops[0], stops[stops.len() - 1]);
        let parts_per_unit =
            Some(PARTS as f64 / (most - least)).filter(|parts| parts.is_finite()).unwrap_or(0.0);
        let mut scale = Scale { stops, colours, inverse, first: Vec::new(), least, parts_per_unit };
        let mut stop = 0;
        let first = (0..PARTS).map(|part| {
            while scale.stops.get(stop + 1).is_some_and(|next| scale.part(*next) < part) {
                stop += 1;
            }
            stop as u16
        });
        scale.first = first.collect();
        scale
    }

    /// Index of the part that contains a number, in ascending order.
    #[inline]
    fn part(&self, number: f64) -> usize {
        (((number - self.least) * self.parts_per_unit) as usize).min(PARTS - 1)
    }

    /// Index of the last stop that is not above a number; 0 if all are.
    #[inline]
    fn stop(&self, number: f64) -> usize {
        let mut stop = usize::from(self.first[self.part(number)]);
        while self.stops.get(stop + 1).is_some_and(|next| *next <= number) {
            stop += 1;
        }
        stop
    }

    /// The colour of a number.
    #[inline]
    pub(super) fn colour(&self, number: f64) -> [u8; 4] {
        let stop = self.stop(number);
        let colour = self.colours[stop];
        let Some(inverse) = self.inverse.get(stop) else { return colour };
        let next = self.colours[stop + 1];
        let share = ((number / 2.0 - self.stops[stop] / 2.0) * inverse).clamp(0.0, 1.0) as f32;
        std::array::from_fn(|i| {
            let (a, b) = (f32::from(colour[i]), f32::from(next[i]));
            (a + (b - a) * share + 0.5) as u8
        })
    }

    /// All colours, if there is no interpolation.
    pub(super) fn steps(&self) -> Option<&[[u8; 4]]> {
        self.inverse.is_empty().then_some(&self.colours)
    }

    pub(super) fn stops(&self) -> impl Iterator<Item = (f64, [u8; 4])> {
        self.stops.iter().copied().zip(self.colours.iter().copied())
    }

    /// All colours.
    pub(super) fn colours(&self) -> &[[u8; 4]] {
        &self.colours
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grey.
    fn grey(grey: u8) -> [u8; 4] {
        [grey, grey, grey, 255]
    }

    #[test]
    fn colours_between_stops() {
        let stops = [(-1.0, grey(0)), (1.0, grey(100)), (1.0, grey(200)), (5.0, grey(240))];
        let greys = |interpolation: Interpolation, numbers: &[f64]| -> Vec<u8> {
            let scale = Scale::new(&stops, interpolation);
            numbers.iter().map(|number| scale.colour(*number)[0]).collect()
        };
        let numbers = [-9.0, -1.0, 0.0, 0.99, 1.0, 3.0, 5.0, 9.0, f64::INFINITY, f64::NEG_INFINITY];
        assert_eq!(greys(Interpolation::Linear, &numbers), [0, 0, 50, 100, 200, 220, 240, 240, 240, 0]);
        assert_eq!(greys(Interpolation::Discrete, &numbers), [0, 0, 0, 0, 200, 200, 240, 240, 240, 0]);
        assert_eq!(greys(Interpolation::Nearest, &numbers), [0, 0, 100, 100, 200, 240, 240, 240, 240, 0]);
    }

    #[test]
    fn any_numbers_are_stops() {
        let ends = [f64::MIN, f64::MAX];
        let scale = Scale::new(&[(ends[0], grey(0)), (ends[1], grey(255))], Interpolation::Linear);
        assert_eq!([f64::MIN, 0.0, f64::MAX].map(|number| scale.colour(number)[0]), [0, 128, 255]);
        let alone = Scale::new(&[(5.0, grey(7)), (5.0, grey(9))], Interpolation::Linear);
        assert_eq!([4.0, 5.0, 6.0].map(|number| alone.colour(number)[0]), [7, 9, 9]);
    }

    #[test]
    fn searches_find_the_stop() {
        // Stops that are dense at one end and sparse at the other.
        let stops: Vec<(f64, [u8; 4])> = (0..200).map(|i| (f64::from(i).powi(5), grey(i as u8))).collect();
        let scale = Scale::new(&stops, Interpolation::Discrete);
        for i in 0..20_000 {
            let number = f64::from(i).powi(3) * 0.043_217;
            let expected = stops.iter().rposition(|stop| stop.0 <= number).unwrap_or(0);
            assert_eq!(scale.colour(number)[0], expected as u8, "{number}");
        }
    }
}

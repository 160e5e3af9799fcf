//! Values of any type as the samples of eight bits that pictures have for the eye.

use super::window::number;
use crate::value::{SampleType, ValueType};

/// The samples of eight bits that values become: a number becomes black, another white, and what lies between them
/// a grey between. Opacity keeps its meaning.
pub(super) struct Stretch {
    sample: SampleType,
    /// The sample that means that there is none, which no range is extended for.
    missing: Option<[u8; 4]>,
    /// For each channel the number that becomes 0 and the one that becomes 255.
    ends: Vec<[f64; 2]>,
    /// Channels that are no opacity.
    colours: usize,
}

impl Stretch {
    /// The stretch of all channels but opacity from `ends` to black and white.
    pub(super) fn new(value: ValueType, alpha: bool, ends: [f64; 2]) -> Stretch {
        let opaque = match value.sample {
            SampleType::U8 => u8::MAX.into(),
            SampleType::U16 => u16::MAX.into(),
            _ => 1.0,
        };
        let mut ends = vec![ends; usize::from(value.channels)];
        if let Some(last) = ends.last_mut().filter(|_| alpha) {
            *last = [0.0, opaque];
        }
        let colours = ends.len() - usize::from(alpha);
        Stretch { sample: value.sample, missing: value.missing, ends, colours }
    }

    /// The samples of whole pixels.
    pub(super) fn apply(&self, bytes: &[u8]) -> Vec<u8> {
        let samples = bytes.chunks_exact(self.sample.size()).zip(self.ends.iter().cycle());
        samples.map(|(bytes, ends)| grey(number(self.sample, bytes), *ends)).collect()
    }

    /// Extends a range so that it has all finite samples of a pixel, but not its opacity.
    pub(super) fn extend(&self, range: &mut Option<[f64; 2]>, pixel: &[u8]) {
        for bytes in pixel.chunks_exact(self.sample.size()).take(self.colours) {
            let number = number(self.sample, bytes);
            let is_missing = self.missing.is_some_and(|missing| missing.starts_with(bytes));
            if number.is_finite() && !is_missing {
                let [low, high] = range.unwrap_or([number; 2]);
                *range = Some([low.min(number), high.max(number)]);
            }
        }
    }
}

/// The grey of a number between those that are black and white; black where there is nothing between.
fn grey(number: f64, [black, white]: [f64; 2]) -> u8 {
    // Halves, because the difference of two numbers may be none.
    let share = (number / 2.0 - black / 2.0) / (white / 2.0 - black / 2.0);
    // (What is less than 0, beyond 255 or no number is cut off.)
    (share * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_become_greys() {
        let greys = |ends: [f64; 2], numbers: &[f64]| -> Vec<u8> {
            numbers.iter().map(|number| grey(*number, ends)).collect()
        };
        assert_eq!(greys([-1.0, 1.0], &[-1.0, 0.0, 1.0, 2.0, -9.0]), [0, 128, 255, 255, 0]);
        assert_eq!(greys([1.0, -1.0], &[-1.0, 1.0]), [255, 0]);
        assert_eq!(greys([f64::MIN, f64::MAX], &[f64::MIN, 0.0, f64::MAX]), [0, 128, 255]);
        assert_eq!(greys([0.0, 1.0], &[f64::NAN, f64::INFINITY, f64::NEG_INFINITY]), [0, 255, 0]);
        assert_eq!(greys([5.0, 5.0], &[5.0]), [0]);
    }

    #[test]
    fn opacity_is_not_stretched() {
        let value = ValueType::new(SampleType::F32, 2);
        let pixel: Vec<u8> = [7.0f32, 0.5].iter().flat_map(|sample| sample.to_le_bytes()).collect();
        let stretch = Stretch::new(value, true, [7.0, 9.0]);
        assert_eq!(stretch.apply(&pixel), [0, 128]);
        let mut range = None;
        stretch.extend(&mut range, &pixel);
        assert_eq!(range, Some([7.0, 7.0]));
    }
}

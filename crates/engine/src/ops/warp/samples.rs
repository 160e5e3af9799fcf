//! Samples of a window as numbers.

use super::window::{Window, floor};
use spinney_base::value::Sample;

/// Samples of a window as numbers.
pub(super) struct Samples<'a, S> {
    pub(super) window: &'a Window,
    /// Numbers are relative to this sample: see [`Sample::relative_to`].
    pub(super) base: S,
}

impl<'a, S: Sample> Samples<'a, S> {
    pub(super) fn new(window: &'a Window) -> Self {
        Samples {
            window,
            base: window
                .valid
                .iter()
                .position(|valid| *valid)
                .map_or(S::default(), |index| S::read(&window.bytes[index * window.value.size()..])),
        }
    }

    /// Samples of all cells, one channel of all cells at a time, NaN where there is none.
    pub(super) fn numbers(&self) -> Vec<f64> {
        let Window { value, valid, bytes, .. } = self.window;
        let mut numbers = Vec::with_capacity(valid.len() * usize::from(value.channels));
        for at in (0..value.size()).step_by(S::TYPE.size()) {
            numbers.extend(bytes.chunks_exact(value.size()).zip(valid).map(|(bytes, valid)| {
                let counts = *valid && value.mask.present(S::TYPE.size(), bytes)[at / S::TYPE.size()];
                if counts { S::read(&bytes[at..]).relative_to(self.base) } else { f64::NAN }
            }));
        }
        numbers
    }

    #[inline]
    pub(super) fn raw(&self, index: usize, channel: usize) -> S {
        let size = S::TYPE.size();
        S::read(&self.window.bytes[index * self.window.value.size() + channel * size..])
    }

    /// Whether a channel of a cell has a sample that counts.
    #[inline]
    pub(super) fn counts(&self, index: usize, channel: usize) -> bool {
        let Window { value, bytes, .. } = self.window;
        value.mask.present(S::TYPE.size(), &bytes[index * value.size()..][..value.size()])[channel]
    }

    /// Sample of a cell's channel, if it is present.
    #[inline]
    pub(super) fn number(&self, x: i64, y: i64, channel: usize) -> Option<f64> {
        let index = self.window.present(x, y)?;
        let number = self.raw(index, channel).relative_to(self.base);
        (!number.is_nan() && self.counts(index, channel)).then_some(number)
    }
}

/// Sample closest to a number. Means of integers are rounded as for whole cells, and overshoots of
/// cubic convolution are clamped.
#[inline]
pub(super) fn rounded<S: Sample>(base: S, number: f64) -> S {
    if const { S::TYPE.is_float() } {
        S::from_f64_lossy(number)
    } else if const { S::TYPE.size() < size_of::<u64>() } {
        // (Without a function call.)
        S::from_f64_lossy(floor(number + 0.5) as f64)
    } else {
        S::from_relative(base, number)
    }
}

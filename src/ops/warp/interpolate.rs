//! Values between the centres of source cells.

use super::lattice::Lattice;
use super::window::{Window, floor};
use crate::tree::CellBlock;
use crate::value::{Sample, SampleType, with_sample_type};

/// Interpolates at the places of a lattice: linearly, or by cubic convolution.
pub(super) fn interpolate(
    window: &Window,
    lattice: &Lattice,
    size: [usize; 2],
    is_cubic: bool,
    block: &mut CellBlock,
) {
    with_sample_type!(window.value.sample, S => interpolate_samples::<S>(window, lattice, size, is_cubic, block));
}

fn interpolate_samples<S: Sample>(
    window: &Window,
    lattice: &Lattice,
    [width, height]: [usize; 2],
    is_cubic: bool,
    block: &mut CellBlock,
) {
    let bytes_each = window.value.size();
    // (NaN is a sample that is missing, of several channels.)
    let has_all = window.value.missing.is_none()
        && (window.value.channels == 1 || !S::TYPE.is_float())
        && window.valid.iter().all(|valid| *valid);
    if has_all && !is_cubic {
        return full_linear::<S>(window, lattice, [width, height], block);
    }
    let samples = Samples::<S>::new(window);
    for y in 0..height {
        for x in 0..width {
            let [column, row] = lattice.at(x, y);
            if !(column.is_finite() && row.is_finite()) {
                continue;
            }
            let Some(nearest) = window.present(floor(column), floor(row)) else { continue };
            let index = y * width + x;
            let value = &mut block.values[index * bytes_each..(index + 1) * bytes_each];
            // Between centres.
            let (column, row) = (column - 0.5, row - 0.5);
            let (first, top) = (floor(column), floor(row));
            let (u, v) = (column - first as f64, row - top as f64);
            for (channel, bytes) in value.chunks_exact_mut(S::TYPE.size()).enumerate() {
                let cubic = if is_cubic { samples.cubic([first, top], [u, v], channel) } else { None };
                let sample = match cubic.or_else(|| samples.linear([first, top], [u, v], channel)) {
                    // (Means of integers are rounded as those of whole cells are; what cubic convolution overshoots is cut off.)
                    Some(number) if S::TYPE.is_float() => S::from_f64_lossy(number),
                    Some(number) => S::from_f64_lossy((number + 0.5).floor()),
                    // (A sample that is missing in all cells around.)
                    None => samples.raw(nearest, channel),
                };
                sample.write(bytes);
            }
            block.present[index] = true;
        }
    }
}

/// Linear interpolation where no sample of the window is missing.
fn full_linear<S: Sample>(
    window: &Window,
    lattice: &Lattice,
    [width, height]: [usize; 2],
    block: &mut CellBlock,
) {
    let (bytes_each, size) = (window.value.size(), S::TYPE.size());
    let stride = window.size[0] * bytes_each;
    for y in 0..height {
        for x in 0..width {
            let [column, row] = lattice.at(x, y);
            // (What has no place is NaN, which is neither.)
            let (column, row) = (column - window.origin[0] as f64 - 0.5, row - window.origin[1] as f64 - 0.5);
            if !(column >= 0.0 && row >= 0.0) {
                continue;
            }
            let (first, top) = (column as usize, row as usize);
            let (u, v) = (column - first as f64, row - top as f64);
            let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
            let start = top * stride + first * bytes_each;
            let (Some(above), Some(below)) = (
                window.bytes.get(start..start + 2 * bytes_each),
                window.bytes.get(start + stride..start + stride + 2 * bytes_each),
            ) else {
                continue;
            };
            let index = y * width + x;
            let value = &mut block.values[index * bytes_each..(index + 1) * bytes_each];
            for (channel, bytes) in value.chunks_exact_mut(size).enumerate() {
                let (left, right) = (channel * size, bytes_each + channel * size);
                let number = |row: &[u8], at: usize| S::read(&row[at..]).to_f64();
                let sum = weights[0] * number(above, left)
                    + weights[1] * number(above, right)
                    + weights[2] * number(below, left)
                    + weights[3] * number(below, right);
                let number = if S::TYPE.is_float() { sum } else { floor(sum + 0.5) as f64 };
                S::from_f64_lossy(number).write(bytes);
            }
            block.present[index] = true;
        }
    }
}

/// The samples of a window as numbers.
struct Samples<'a, S> {
    window: &'a Window,
    missing: Option<S>,
}

impl<'a, S: Sample> Samples<'a, S> {
    fn new(window: &'a Window) -> Self {
        Samples {
            window,
            missing: window.value.missing.map(|bytes| S::read(&[&bytes[..], &[0; 4]].concat())),
        }
    }

    #[inline]
    fn raw(&self, index: usize, channel: usize) -> S {
        let size = S::TYPE.size();
        S::read(&self.window.bytes[index * self.window.value.size() + channel * size..])
    }

    /// The sample of a channel of a cell, if it is there.
    #[inline]
    fn number(&self, x: i64, y: i64, channel: usize) -> Option<f64> {
        let sample = self.raw(self.window.present(x, y)?, channel);
        let number = sample.to_f64();
        (!number.is_nan() && self.missing != Some(sample)).then_some(number)
    }

    /// The mean of the four samples around a place, weighted by nearness, without those that are not there.
    #[inline]
    fn linear(&self, [x, y]: [i64; 2], [u, v]: [f64; 2], channel: usize) -> Option<f64> {
        let (mut sum, mut weights) = (0.0, 0.0);
        for (step, weight) in [
            ((0, 0), (1.0 - u) * (1.0 - v)),
            ((1, 0), u * (1.0 - v)),
            ((0, 1), (1.0 - u) * v),
            ((1, 1), u * v),
        ] {
            if let Some(number) = self.number(x + step.0, y + step.1, channel) {
                sum += weight * number;
                weights += weight;
            }
        }
        // (Where all are there the weights add up to one, but for rounding.)
        if (weights - 1.0).abs() < 1e-12 {
            return Some(sum);
        }
        (weights > 1e-9).then(|| sum / weights)
    }

    /// Cubic convolution of the 16 samples around a place, if all are there.
    fn cubic(&self, [x, y]: [i64; 2], [u, v]: [f64; 2], channel: usize) -> Option<f64> {
        let (along, down) = (keys(u), keys(v));
        let mut sum = 0.0;
        for (j, down) in (-1..).zip(down) {
            for (i, along) in (-1..).zip(along) {
                sum += along * down * self.number(x + i, y + j, channel)?;
            }
        }
        Some(sum)
    }
}

/// Weights of four samples in a row for a place so far behind the second.
fn keys(t: f64) -> [f64; 4] {
    [
        ((-0.5 * t + 1.0) * t - 0.5) * t,
        (1.5 * t - 2.5) * t * t + 1.0,
        ((-1.5 * t + 2.0) * t + 0.5) * t,
        (0.5 * t - 0.5) * t * t,
    ]
}

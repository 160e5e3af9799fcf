//! Values between the centres of source cells.

use super::lattice::Lattice;
use super::samples::{Samples, rounded};
use super::window::{Window, floor};
use crate::tree::CellBlock;
use spinney_base::value::{Mask, Sample, with_sample_type};

/// Interpolates at the positions of a lattice: bilinear, or by cubic convolution.
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
    let samples = Samples::<S>::new(window);
    let (bytes_each, size) = (window.value.size(), S::TYPE.size());
    let mut store = |y: usize, row: &[f64]| {
        let cells = y * width..(y + 1) * width;
        let values = &mut block.values[cells.start * bytes_each..cells.end * bytes_each];
        let present = &mut block.present[cells];
        for (channel, row) in row.chunks_exact(width).enumerate() {
            let cells = values.chunks_exact_mut(bytes_each).zip(&mut *present);
            for (x, (number, (value, present))) in row.iter().zip(cells).enumerate() {
                let sample = if number.is_nan() {
                    match samples.careful(lattice.at(x, y), is_cubic, channel) {
                        Some(sample) => sample,
                        None => continue,
                    }
                } else {
                    rounded(samples.base, *number)
                };
                sample.write(&mut value[channel * size..]);
                *present = true;
            }
        }
    };
    let grid = Grid { origin: window.origin, size: window.size, numbers: samples.numbers() };
    if is_cubic {
        grid.convolve(lattice, [width, height], keys, &mut store);
    } else {
        grid.convolve(lattice, [width, height], |t| [1.0 - t, t], &mut store);
    }
}

/// Numbers of a window, NaN where there is none: rows, channel by channel.
struct Grid {
    /// First column and row.
    origin: [i64; 2],
    /// Columns and rows.
    size: [usize; 2],
    numbers: Vec<f64>,
}

/// Neighbours along an axis that contribute to a position: index of the first, and weights.
#[derive(Clone, Copy)]
struct Taps<const N: usize> {
    first: usize,
    weights: [f64; N],
}

impl<const N: usize> Taps<N> {
    /// Weighted sum of the neighbours in a row.
    #[inline]
    fn sum(&self, row: &[f64]) -> f64 {
        row[self.first..][..N].iter().zip(self.weights).map(|(number, weight)| number * weight).sum()
    }
}

impl Grid {
    /// Convolves the `N` neighbours along each axis of the lattice's positions. `weights` gets the
    /// offset of a position from the first neighbour of the middle pair. Passes rows of sums to
    /// `store`, channel by channel, which are NaN where a neighbour is, or the position is
    /// undefined.
    fn convolve<const N: usize>(
        &self,
        lattice: &Lattice,
        [width, height]: [usize; 2],
        weights: impl Fn(f64) -> [f64; N],
        store: &mut dyn FnMut(usize, &[f64]),
    ) {
        let taps = |place: f64, axis: usize| {
            let place = place - 0.5 - self.origin[axis] as f64 - (N / 2 - 1) as f64;
            // (An undefined position is NaN.)
            let first = place as usize;
            let is_inside = place >= 0.0 && first <= self.size[axis].checked_sub(N)?;
            is_inside.then(|| Taps { first, weights: weights(place - first as f64) })
        };
        let (stride, cells) = (self.size[0], self.size[0] * self.size[1]);
        let channels = self.numbers.len() / cells;
        let mut row = vec![0.0; channels * width];
        match lattice {
            Lattice::Separable { columns, rows } => {
                let nowhere = Taps { first: 0, weights: [f64::NAN; N] };
                let columns: Vec<Taps<N>> =
                    columns.iter().map(|column| taps(*column, 0).unwrap_or(nowhere)).collect();
                // Source rows convolved along columns, with their indices: the next target row
                // needs most of them again.
                let mut along: [_; N] = std::array::from_fn(|_| (usize::MAX, row.clone()));
                for (y, place) in rows.iter().enumerate() {
                    let Some(down) = taps(*place, 1) else { continue };
                    row.fill(0.0);
                    for (from, weight) in (down.first..).zip(down.weights) {
                        let (number, sums) = &mut along[from % N];
                        if *number != from {
                            for (channel, sums) in sums.chunks_exact_mut(width).enumerate() {
                                let source = &self.numbers[channel * cells + from * stride..][..stride];
                                sums.iter_mut().zip(&columns).for_each(|(sum, taps)| *sum = taps.sum(source));
                            }
                            *number = from;
                        }
                        row.iter_mut().zip(sums).for_each(|(to, sum)| *to += weight * *sum);
                    }
                    store(y, &row);
                }
            }
            Lattice::Points { points, .. } => {
                for (y, points) in points.chunks_exact(width).take(height).enumerate() {
                    row.fill(f64::NAN);
                    for (x, [column, place]) in points.iter().enumerate() {
                        let (Some(along), Some(down)) = (taps(*column, 0), taps(*place, 1)) else { continue };
                        for (to, source) in
                            row[x..].iter_mut().step_by(width).zip(self.numbers.chunks_exact(cells))
                        {
                            let rows = source[down.first * stride..].chunks(stride).zip(down.weights);
                            *to = rows.map(|(row, weight)| weight * along.sum(row)).sum();
                        }
                    }
                    store(y, &row);
                }
            }
        }
    }
}

impl<S: Sample> Samples<'_, S> {
    /// Sample at a position near which samples may be missing; `None` is VOID.
    #[cold]
    fn careful(&self, [column, row]: [f64; 2], is_cubic: bool, channel: usize) -> Option<S> {
        if !(column.is_finite() && row.is_finite()) {
            return None;
        }
        let nearest = self.window.present(floor(column), floor(row))?;
        // (Transparent areas keep their shape, as VOID does.)
        if self.window.value.mask == Mask::Alpha && !self.counts(nearest, channel) {
            return Some(self.raw(nearest, channel));
        }
        // Between centres.
        let (column, row) = (column - 0.5, row - 0.5);
        let (first, top) = (floor(column), floor(row));
        let (u, v) = (column - first as f64, row - top as f64);
        let cubic = if is_cubic { self.cubic([first, top], [u, v], channel) } else { None };
        Some(match cubic.or_else(|| self.linear([first, top], [u, v], channel)) {
            Some(number) => rounded(self.base, number),
            // (The sample is missing in all neighbours.)
            None => self.raw(nearest, channel),
        })
    }

    /// Bilinear mean of the four samples around a position, without those that are missing.
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
        // (If all are present, the weights add up to one, except for rounding.)
        if (weights - 1.0).abs() < 1e-12 {
            return Some(sum);
        }
        (weights > 1e-9).then(|| sum / weights)
    }

    /// Cubic convolution of the 16 samples around a position, if all are present.
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

/// Weights of four consecutive samples for a position at offset `t` from the second.
fn keys(t: f64) -> [f64; 4] {
    [
        ((-0.5 * t + 1.0) * t - 0.5) * t,
        (1.5 * t - 2.5) * t * t + 1.0,
        ((-1.5 * t + 2.0) * t + 0.5) * t,
        (0.5 * t - 0.5) * t * t,
    ]
}

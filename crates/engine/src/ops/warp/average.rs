//! Means of the source cells that rectangles cover.

use super::area::Span;
use super::samples::{Samples, rounded};
use super::window::Window;
use crate::tree::CellBlock;
use spinney_base::value::{Sample, with_sample_type};

/// Sets each cell between lines of columns and rows to the mean of the source cells that it covers,
/// if all of them are in the window and have all their samples; other cells stay VOID. Rows are
/// summed along columns first, vectorized.
///
/// Cells with samples of 64 bits stay VOID, too: their sums may not be exact where all cells are
/// equal.
pub(super) fn average(window: &Window, columns: &[Span], rows: &[Span], block: &mut CellBlock) {
    let sample = window.value.sample;
    if sample.size() >= size_of::<u64>() || window.valid.is_empty() {
        return;
    }
    let numbers = with_sample_type!(sample, S => Samples::<S>::new(window).numbers());
    let (bytes_each, width) = (window.value.size(), columns.len());
    let [stride, height] = window.size;
    // For each cell, the first column in the window, and the fractions of columns that it covers.
    let along: Vec<(usize, &[f64], f64)> = columns
        .iter()
        .map(|(left, parts)| {
            let first = left - window.origin[0];
            let is_inside = first >= 0 && first as usize + parts.len() <= stride;
            if is_inside { (first as usize, &parts[..], parts.iter().sum()) } else { (0, &[][..], 0.0) }
        })
        .collect();
    let mut sums = vec![0.0; numbers.len() / height];
    let mut means = vec![0.0; usize::from(window.value.channels) * width];
    for (y, (top, parts)) in rows.iter().enumerate() {
        let first = top - window.origin[1];
        if parts.is_empty() || first < 0 || first as usize + parts.len() > height {
            continue;
        }
        sums.fill(0.0);
        for (sums, numbers) in sums.chunks_exact_mut(stride).zip(numbers.chunks_exact(stride * height)) {
            for (row, part) in numbers.chunks_exact(stride).skip(first as usize).zip(parts) {
                sums.iter_mut().zip(row).for_each(|(sum, number)| *sum += part * number);
            }
        }
        let down: f64 = parts.iter().sum();
        for (means, sums) in means.chunks_exact_mut(width).zip(sums.chunks_exact(stride)) {
            for (mean, (first, parts, along)) in means.iter_mut().zip(&along) {
                let sums = sums[*first..][..parts.len()].iter();
                // (The mean is NaN if a sample is missing, or if there are no columns.)
                *mean = sums.zip(*parts).map(|(sum, part)| sum * part).sum::<f64>() / (along * down);
            }
        }
        let cells = y * width..(y + 1) * width;
        let values = &mut block.values[cells.start * bytes_each..cells.end * bytes_each];
        with_sample_type!(sample, S => store::<S>(&means, values, &mut block.present[cells]));
    }
}

/// Stores the means of a row, given channel by channel, except for cells with a NaN.
fn store<S: Sample>(means: &[f64], values: &mut [u8], present: &mut [bool]) {
    let (width, size) = (present.len(), S::TYPE.size());
    let cells = values.chunks_exact_mut(means.len() / width * size).zip(present);
    for (x, (value, present)) in cells.enumerate() {
        let means = means[x..].iter().step_by(width);
        *present = !means.clone().any(|mean| mean.is_nan());
        if *present {
            let samples = value.chunks_exact_mut(size).zip(means);
            samples.for_each(|(sample, mean)| rounded(S::default(), *mean).write(sample));
        }
    }
}

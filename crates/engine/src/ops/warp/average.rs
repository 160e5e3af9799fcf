//! Means of the source cells that rectangles cover.

use super::area::Span;
use super::samples::{Samples, rounded};
use super::window::Window;
use crate::tree::CellBlock;
use spinney_base::value::{Sample, with_sample_type};

/// Gives each cell between lines of columns and rows the mean of the source cells that it covers, if all of them are in the window and
/// have all their samples; other cells stay VOID. Rows are added up along columns first, as vectors.
///
/// Samples of 64 bits stay, too: their sums may not be exact where all cells are equal.
pub(super) fn average(window: &Window, columns: &[Span], rows: &[Span], block: &mut CellBlock) {
    if window.value.sample.size() < size_of::<u64>() && !window.valid.is_empty() {
        with_sample_type!(window.value.sample, S => average_samples::<S>(window, columns, rows, block));
    }
}

fn average_samples<S: Sample>(window: &Window, columns: &[Span], rows: &[Span], block: &mut CellBlock) {
    let samples = Samples::<S>::new(window);
    let numbers = samples.numbers();
    let (bytes_each, size, width) = (window.value.size(), S::TYPE.size(), columns.len());
    let [stride, height] = window.size;
    // Of each cell the first column in the window, and the parts of columns that it covers.
    let along: Vec<(usize, &[f64], f64)> = columns
        .iter()
        .map(|(left, parts)| {
            let first = left - window.origin[0];
            let is_inside = first >= 0 && first as usize + parts.len() <= stride;
            if is_inside { (first as usize, &parts[..], parts.iter().sum()) } else { (0, &[][..], 0.0) }
        })
        .collect();
    let mut sums = vec![0.0; numbers.len() / height];
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
        let cells = y * width..(y + 1) * width;
        let values =
            block.values[cells.start * bytes_each..cells.end * bytes_each].chunks_exact_mut(bytes_each);
        for ((value, present), (first, parts, along)) in values.zip(&mut block.present[cells]).zip(&along) {
            let mean = |sums: &[f64]| {
                let sum: f64 =
                    sums[*first..][..parts.len()].iter().zip(*parts).map(|(sum, part)| sum * part).sum();
                sum / (along * down)
            };
            // (The mean is NaN if a sample is missing, and of no columns.)
            *present = true;
            for (sums, sample) in sums.chunks_exact(stride).zip(value.chunks_exact_mut(size)) {
                let mean = mean(sums);
                *present &= !mean.is_nan();
                rounded(samples.base, mean).write(sample);
            }
            if !*present {
                value.fill(0);
            }
        }
    }
}

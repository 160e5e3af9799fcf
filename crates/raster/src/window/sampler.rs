//! Rows of a window: cells as they are, means of what pixels cover, or the cells at their centres.

use super::TakeRows;
use super::grid::{OutputGrid, PixelContent, is_averaged};
use super::means::{Cells, Means};
use super::span::Span;
use spinney_base::value::{Rule, SampleType, ValueType};
use spinney_base::{Progress, Result};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::PixelGrid;

/// Rows of a window, straight or resampled.
pub(super) struct Sampler<'a> {
    pub(super) tree: &'a Dataset,
    pub(super) grid: OutputGrid,
    /// The number that stands for VOID.
    pub(super) fill: f64,
}

impl Sampler<'_> {
    /// Hands out all pixels of the output, and whether each has a value, in bands of so many rows; from the last row
    /// on if it is upright.
    pub(super) fn bands(
        &self,
        rows: u64,
        is_upright: bool,
        progress: &dyn Progress,
        each: &mut TakeRows<'_>,
    ) -> Result<()> {
        let OutputGrid { width, height, .. } = self.grid;
        let mut row = 0;
        while row < height {
            progress.check()?;
            let count = rows.min(height - row);
            let first = if is_upright { height - row - count } else { row };
            let (mut bytes, mut valid) = self.band(first, count, progress)?;
            if is_upright {
                flip_rows(&mut bytes, width as usize * self.tree.header().form.value.size());
                flip_rows(&mut valid, width as usize);
            }
            each(&bytes, &valid)?;
            row += count;
        }
        Ok(())
    }

    /// Some rows of the output, and whether each of their pixels has a value.
    pub(super) fn band(
        &self,
        first: u64,
        count: u64,
        progress: &dyn Progress,
    ) -> Result<(Vec<u8>, Vec<bool>)> {
        match self.grid.pixels {
            PixelContent::Cell => self.copy(first, count),
            PixelContent::Resampled => self.resample(first, count),
            PixelContent::Exact => self.average(first, count, progress),
        }
    }

    /// The cells of some rows of the level, and whether each has a value.
    fn rows(&self, first: u64, end: u64) -> Result<(Vec<u8>, Vec<bool>)> {
        let mut bounds = self.grid.source;
        let rows = self.grid.axes[1];
        (bounds.min[rows], bounds.max[rows]) = (first, end);
        let cells = bounds.volume() as usize;
        let mut bytes = vec![0; cells * self.tree.header().form.value.size()];
        let mut valid = vec![true; cells];
        self.tree.window(self.grid.level, &bounds, self.fill, &mut bytes, Some(&mut valid))?;
        if self.tree.header().rule == Rule::Occupancy {
            // VOID is a number, too: an empty cell.
            valid.fill(true);
        }
        Ok((bytes, valid))
    }

    /// Rows of the output that are rows of cells.
    fn copy(&self, row: u64, count: u64) -> Result<(Vec<u8>, Vec<bool>)> {
        let first = self.grid.source.min[self.grid.axes[1]] + row;
        self.rows(first, first + count)
    }

    /// Rows of the output whose pixels are means of the cells that they cover, weighted by area, or the cells
    /// at their centres.
    fn resample(&self, row: u64, count: u64) -> Result<(Vec<u8>, Vec<bool>)> {
        let OutputGrid { source, axes: [u, v], origin, step, width, .. } = self.grid;
        let value_type = self.tree.header().form.value;
        let ValueType { sample, channels, .. } = value_type;
        let missing = value_type.all_missing().map_or(self.fill, |value| value_type.first_sample(value));
        let mean = is_averaged(self.tree);
        let spans = |axis: usize, first: u64, count: u64, min: u64, max: u64| -> Vec<Span> {
            (first..first + count)
                .map(|i| Span::new(origin[axis] + i as f64 * step[axis], step[axis], mean, min, max))
                .collect()
        };
        let columns = spans(0, 0, width, source.min[u], source.max[u]);
        let lines = spans(1, row, count, source.min[v], source.max[v]);
        let (first, end) = (lines[0].first, lines[lines.len() - 1].end);
        let (bytes, valid) = self.rows(first, end)?;
        let source_width = source.size()[u];
        let (size, channels) = (sample.size(), channels as usize);
        let mut out = Vec::with_capacity(count as usize * width as usize * size * channels);
        let mut out_valid = Vec::with_capacity(count as usize * width as usize);
        if mean {
            let with_shares = |span: Span| {
                let shares = (span.first..span.end).map(|cell| span.share(cell)).collect();
                (span, shares)
            };
            let columns: Vec<_> = columns.into_iter().map(with_shares).collect();
            let first = [first, source.min[u]];
            let (width, bytes, valid) = (source_width as usize, &bytes, &valid);
            let mut means = Means::new(Cells { value: value_type, first, width, bytes, valid });
            for line in &lines {
                means.line(line, &columns, &mut |pixel| {
                    let is_valid = pixel.iter().any(Option::is_some);
                    out_valid.push(is_valid);
                    let none = if is_valid { missing } else { self.fill };
                    for number in &pixel[..channels] {
                        push_number(sample, number.unwrap_or(none), &mut out);
                    }
                });
            }
            return Ok((out, out_valid));
        }
        for line in &lines {
            for column in &columns {
                let index = ((line.first - first) * source_width + column.first - source.min[u]) as usize;
                out_valid.push(valid[index]);
                if valid[index] {
                    out.extend_from_slice(&bytes[index * channels * size..][..channels * size]);
                } else {
                    (0..channels).for_each(|_| push_number(sample, self.fill, &mut out));
                }
            }
        }
        Ok((out, out_valid))
    }

    /// Rows of the output whose pixels are exact means of the deepest cells.
    fn average(&self, row: u64, count: u64, progress: &dyn Progress) -> Result<(Vec<u8>, Vec<bool>)> {
        let OutputGrid { source, axes, origin, step, width, .. } = self.grid;
        let value_type = self.tree.header().form.value;
        let ValueType { sample, channels, .. } = value_type;
        let missing = value_type.all_missing().map_or(self.fill, |value| value_type.first_sample(value));
        let first = origin[1] + row as f64 * step[1];
        let grid =
            PixelGrid { axes, origin: [origin[0], first], step, size: [width as usize, count as usize] };
        let mut bounds = source;
        let rows = axes[1];
        bounds.min[rows] = (first as u64).clamp(source.min[rows], source.max[rows] - 1);
        let end = (first + count as f64 * step[1]).ceil() as u64;
        bounds.max[rows] = end.clamp(bounds.min[rows] + 1, source.max[rows]);
        let sums = self.tree.pixel_sums(&bounds, grid, progress)?;
        let is_occupancy = self.tree.header().rule == Rule::Occupancy;
        let mut bytes = Vec::with_capacity(sums.sums.len() * sample.size() * usize::from(channels));
        let mut valid = Vec::with_capacity(sums.sums.len());
        for (sums, areas) in sums.sums.iter().zip(&sums.areas) {
            let is_valid = is_occupancy || areas.iter().any(|area| *area > 0.0);
            valid.push(is_valid);
            let none = if is_valid { missing } else { self.fill };
            for (sum, area) in sums.iter().zip(areas).take(usize::from(channels)) {
                // VOID is a number in trees of occupancy: an empty cell.
                let weight = if is_occupancy { step[0] * step[1] } else { *area };
                let void = if is_occupancy { (weight - area).max(0.0) * self.fill } else { 0.0 };
                push_number(sample, if weight > 0.0 { (sum + void) / weight } else { none }, &mut bytes);
            }
        }
        Ok((bytes, valid))
    }
}

/// Reverses the order of rows.
pub(super) fn flip_rows<T>(cells: &mut [T], width: usize) {
    // Reversing all cells reverses rows, too; reversing each row puts its own cells right again.
    cells.reverse();
    cells.chunks_mut(width).for_each(<[T]>::reverse);
}

fn push_number(sample: SampleType, number: f64, bytes: &mut Vec<u8>) {
    match sample {
        SampleType::U8 => bytes.push((number + 0.5).floor() as u8),
        SampleType::U16 => bytes.extend(((number + 0.5).floor() as u16).to_le_bytes()),
        SampleType::I16 => bytes.extend(((number + 0.5).floor() as i16).to_le_bytes()),
        SampleType::U32 => bytes.extend(((number + 0.5).floor() as u32).to_le_bytes()),
        SampleType::I32 => bytes.extend(((number + 0.5).floor() as i32).to_le_bytes()),
        SampleType::F32 => bytes.extend((number as f32).to_le_bytes()),
        SampleType::F64 => bytes.extend(number.to_le_bytes()),
    }
}

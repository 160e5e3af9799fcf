//! Rows of a window: cells as they are, means of what pixels cover, or the cells at their centres.

use super::RowSink;
use super::grid::{OutputGrid, PixelContent, is_averaged};
use super::means::{Cells, Columns, Means};
use super::span::Span;
use spinney_base::value::{Number, Rule, Sample, SampleType, Value, ValueType};
use spinney_base::{Progress, Result};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::PixelGrid;

/// Bytes of cells that are averaged at a time, at least a line's: few enough to stay in a processor's cache between being read and added up.
const CACHED: usize = 1 << 18;

/// Rows of a window, straight or resampled.
pub(super) struct Sampler<'a> {
    pub(super) tree: &'a Dataset,
    pub(super) grid: OutputGrid,
    /// The number that stands for VOID.
    pub(super) fill: Number,
}

impl Sampler<'_> {
    /// Hands out all pixels of the output, and whether each has a value, in bands of so many rows; from the last row
    /// on if it is upright.
    pub(super) fn bands(
        &self,
        rows: u64,
        is_upright: bool,
        progress: &dyn Progress,
        each: &mut RowSink<'_>,
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
        let (mut bytes, valid) = match self.grid.pixels {
            PixelContent::Cell => self.copy(first, count)?,
            PixelContent::Resampled => self.resample(first, count)?,
            PixelContent::Exact => self.average(first, count, progress)?,
        };
        self.put_missing(&mut bytes, &valid);
        Ok((bytes, valid))
    }

    /// Gives missing samples the number of VOID, if that is not the one which they have in the tree.
    fn put_missing(&self, bytes: &mut [u8], valid: &[bool]) {
        let value = self.tree.header().form.value;
        let (Some(missing), void) = (value.all_missing(), self.void()) else { return };
        if missing == void {
            return;
        }
        let (void, size) = (void.to_bytes(), value.sample.size());
        let pixels = bytes.chunks_exact_mut(value.size()).zip(valid).filter(|(_, valid)| **valid);
        for (pixel, _) in pixels {
            let present = value.present(Value::from_bytes(pixel));
            let samples = pixel.chunks_exact_mut(size).zip(present).filter(|(_, is_present)| !is_present);
            samples.for_each(|(sample, _)| sample.copy_from_slice(&void[..size]));
        }
    }

    /// The cells of some rows of the level, and whether each has a value.
    fn rows(&self, first: u64, end: u64) -> Result<(Vec<u8>, Vec<bool>)> {
        let (mut bytes, mut valid) = (Vec::new(), Vec::new());
        self.read(first, end, &mut bytes, Some(&mut valid))?;
        Ok((bytes, valid))
    }

    /// Reads the cells of some rows of the level, and whether each has a value if that is asked for, to buffers whose former contents
    /// go.
    fn read(&self, first: u64, end: u64, bytes: &mut Vec<u8>, valid: Option<&mut Vec<bool>>) -> Result<()> {
        let mut bounds = self.grid.source;
        let rows = self.grid.axes[1];
        (bounds.min[rows], bounds.max[rows]) = (first, end);
        let cells = bounds.volume() as usize;
        bytes.resize(cells * self.tree.header().form.value.size(), 0);
        let valid = valid.map(|valid| {
            valid.resize(cells, true);
            valid.as_mut_slice()
        });
        let is_occupancy = self.tree.header().rule == Rule::Occupancy;
        match valid {
            // VOID is a number, too: an empty cell.
            Some(valid) if is_occupancy => {
                valid.fill(true);
                self.tree.window(self.grid.level, &bounds, self.fill, bytes, None)
            }
            valid => self.tree.window(self.grid.level, &bounds, self.fill, bytes, valid),
        }
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
        let mean = is_averaged(self.tree);
        let spans = |axis: usize, first: u64, count: u64, min: u64, max: u64| -> Vec<Span> {
            (first..first + count)
                .map(|i| Span::new(origin[axis] + i as f64 * step[axis], step[axis], mean, min, max))
                .collect()
        };
        let columns = spans(0, 0, width, source.min[u], source.max[u]);
        let lines = spans(1, row, count, source.min[v], source.max[v]);
        if mean { self.means(&columns, &lines) } else { self.centres(&columns, &lines) }
    }

    /// Pixels that are means of the cells that they cover.
    fn means(&self, columns: &[Span], lines: &[Span]) -> Result<(Vec<u8>, Vec<bool>)> {
        let value = self.tree.header().form.value;
        let (base, void) = (self.base()?, self.void());
        let fill = value.samples_from(base, void)[0];
        let none = value.mean_of_none().map_or(fill, |none| value.first_sample(none));
        let first = self.grid.source.min[self.grid.axes[0]];
        let width = self.grid.source.size()[self.grid.axes[0]] as usize;
        let row_bytes = width * (value.size() + 1);
        let columns = Columns::new(columns, first);
        let samples = columns.len() * usize::from(value.channels);
        let mut out = Vec::with_capacity(lines.len() * samples * value.sample.size());
        let mut out_valid = vec![true; lines.len() * columns.len()];
        let mut flags = out_valid.chunks_exact_mut(columns.len());
        let may_be_void = self.may_be_void()?;
        let (mut bytes, mut valid) = (Vec::new(), Vec::new());
        let (mut means, mut numbers) = (Means::default(), vec![0.0; samples]);
        let mut rest = lines;
        while let Some(Span { first, .. }) = rest.first() {
            let most = first + (CACHED / row_bytes) as u64;
            let count = rest.iter().take_while(|line| line.end <= most).count().max(1);
            let (now, later) = rest.split_at(count);
            rest = later;
            let end = now[count - 1].end;
            self.read(*first, end, &mut bytes, may_be_void.then_some(&mut valid))?;
            let valid = may_be_void.then_some(&valid[..]);
            let cells = Cells { value, first: *first, width, bytes: &bytes, valid, base };
            for (line, flags) in now.iter().zip(&mut flags) {
                means.line(&cells, line, &columns, [none, fill], (&mut numbers, flags));
                push_numbers(value.sample, base, &numbers, &mut out);
            }
        }
        put_void(value, void, &mut out, &out_valid);
        Ok((out, out_valid))
    }

    /// Whether some cells that pixels cover may have no value.
    fn may_be_void(&self) -> Result<bool> {
        let OutputGrid { source, level, .. } = &self.grid;
        if self.tree.header().rule == Rule::Occupancy {
            return Ok(false);
        }
        // (Of the whole picture, which the file knows without a look at the cells.)
        Ok(!self.tree.extent_at(*level).contains(source)
            || self.tree.may_have_void(self.tree.header().picture())?)
    }

    /// The value that stands for VOID.
    fn void(&self) -> Value {
        self.tree.header().form.value.nearest_numbers(|_| self.fill)
    }

    /// The value that means are computed relative to: the least of the tree, of integers of 64 bits. (An empty cell is 0 in trees of
    /// occupancy, whatever that is relative to.)
    fn base(&self) -> Result<Value> {
        let header = self.tree.header();
        let sample = header.form.value.sample;
        if !sample.is_wide_integer() || header.rule == Rule::Occupancy {
            return Ok(Value::ZERO);
        }
        let least = self.tree.exact_bounds()?.first().map_or(Number::default(), |(least, _)| *least);
        Ok(header.form.value.nearest_numbers(|_| least))
    }

    /// Pixels that are the cells at their centres.
    fn centres(&self, columns: &[Span], lines: &[Span]) -> Result<(Vec<u8>, Vec<bool>)> {
        let value = self.tree.header().form.value;
        let (first, end) = (lines[0].first, lines[lines.len() - 1].end);
        let (bytes, valid) = self.rows(first, end)?;
        let (min, width) =
            (self.grid.source.min[self.grid.axes[0]], self.grid.source.size()[self.grid.axes[0]]);
        let pixels = lines.len() * columns.len();
        let mut out = Vec::with_capacity(pixels * value.size());
        let mut out_valid = Vec::with_capacity(pixels);
        let void = self.void().to_bytes();
        let void = &void[..value.size()];
        for line in lines {
            for column in columns {
                let index = ((line.first - first) * width + column.first - min) as usize;
                out_valid.push(valid[index]);
                let cell = &bytes[index * value.size()..][..value.size()];
                out.extend_from_slice(if valid[index] { cell } else { void });
            }
        }
        Ok((out, out_valid))
    }

    /// Rows of the output whose pixels are exact means of the deepest cells.
    fn average(&self, row: u64, count: u64, progress: &dyn Progress) -> Result<(Vec<u8>, Vec<bool>)> {
        let OutputGrid { source, axes, origin, step, width, .. } = self.grid;
        let value_type = self.tree.header().form.value;
        let ValueType { sample, channels, .. } = value_type;
        let (base, void) = (self.base()?, self.void());
        let fill = value_type.samples_from(base, void)[0];
        let missing = value_type.mean_of_none().map_or(fill, |value| value_type.first_sample(value));
        let first = origin[1] + row as f64 * step[1];
        let grid =
            PixelGrid { axes, origin: [origin[0], first], step, size: [width as usize, count as usize] };
        let mut bounds = source;
        let rows = axes[1];
        bounds.min[rows] = (first as u64).clamp(source.min[rows], source.max[rows] - 1);
        let end = (first + count as f64 * step[1]).ceil() as u64;
        bounds.max[rows] = end.clamp(bounds.min[rows] + 1, source.max[rows]);
        let sums = self.tree.pixel_sums(&bounds, grid, base, progress)?;
        let is_occupancy = self.tree.header().rule == Rule::Occupancy;
        let mut numbers = Vec::with_capacity(sums.sums.len() * usize::from(channels));
        let mut valid = Vec::with_capacity(sums.sums.len());
        for (sums, areas) in sums.sums.iter().zip(&sums.areas) {
            let is_valid = is_occupancy || areas.iter().any(|area| *area > 0.0);
            valid.push(is_valid);
            let none = if is_valid { missing } else { fill };
            for (sum, area) in sums.iter().zip(areas).take(usize::from(channels)) {
                // VOID is a number in trees of occupancy: an empty cell.
                let weight = if is_occupancy { step[0] * step[1] } else { *area };
                let void = if is_occupancy { (weight - area).max(0.0) * fill } else { 0.0 };
                numbers.push(if weight > 0.0 { (sum + void) / weight } else { none });
            }
        }
        let mut bytes = Vec::with_capacity(numbers.len() * sample.size());
        push_numbers(sample, base, &numbers, &mut bytes);
        put_void(value_type, void, &mut bytes, &valid);
        Ok((bytes, valid))
    }
}

/// Reverses the order of rows.
pub(super) fn flip_rows<T>(cells: &mut [T], width: usize) {
    // Reversing all cells reverses rows, too; reversing each row puts its own cells right again.
    cells.reverse();
    cells.chunks_mut(width).for_each(<[T]>::reverse);
}

/// Gives VOID pixels their value, where numbers to compute with are not exact.
fn put_void(value: ValueType, void: Value, bytes: &mut [u8], valid: &[bool]) {
    if matches!(value.sample, SampleType::U64 | SampleType::I64) {
        let pixels = bytes.chunks_exact_mut(value.size()).zip(valid).filter(|(_, valid)| !**valid);
        pixels.for_each(|(pixel, _)| void.write(pixel));
    }
}

/// Appends numbers, which are relative to a value, as samples of a type: whole ones rounded half up, and kept within what the type can hold.
fn push_numbers(sample: SampleType, base: Value, numbers: &[f64], bytes: &mut Vec<u8>) {
    // (A number that is cut off is rounded down if it is no less than 0; unsigned types have nothing below. As a call, rounding down takes
    // longer than all else.)
    fn rounded(number: f64) -> i64 {
        let half_up = number + 0.5;
        let whole = half_up as i64;
        whole.saturating_sub(i64::from(whole as f64 > half_up))
    }
    fn push<const N: usize>(numbers: &[f64], bytes: &mut Vec<u8>, sample: impl Fn(f64) -> [u8; N]) {
        bytes.extend(numbers.iter().flat_map(|number| sample(*number)));
    }
    match sample {
        SampleType::U8 => push(numbers, bytes, |number| [(number + 0.5) as u8]),
        SampleType::U16 => push(numbers, bytes, |number| ((number + 0.5) as u16).to_le_bytes()),
        SampleType::I16 => push(numbers, bytes, |number| {
            (rounded(number).clamp(i16::MIN.into(), i16::MAX.into()) as i16).to_le_bytes()
        }),
        SampleType::U32 => push(numbers, bytes, |number| ((number + 0.5) as u32).to_le_bytes()),
        SampleType::I32 => push(numbers, bytes, |number| {
            (rounded(number).clamp(i32::MIN.into(), i32::MAX.into()) as i32).to_le_bytes()
        }),
        SampleType::F32 => push(numbers, bytes, |number| (number as f32).to_le_bytes()),
        SampleType::F64 => push(numbers, bytes, f64::to_le_bytes),
        SampleType::I8 => {
            push(numbers, bytes, |number| [rounded(number).clamp(i8::MIN.into(), i8::MAX.into()) as i8 as u8])
        }
        SampleType::U64 => {
            let base = u64::read(&base.to_bytes());
            push(numbers, bytes, |number| u64::from_relative(base, number).to_le_bytes());
        }
        SampleType::I64 => {
            let base = i64::read(&base.to_bytes());
            push(numbers, bytes, |number| i64::from_relative(base, number).to_le_bytes());
        }
    }
}

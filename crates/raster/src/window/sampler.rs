//! Reads rows of a window: cells unchanged, means of the cells that a pixel covers, or the cells at
//! pixel centres.

use super::RowSink;
use super::grid::{OutputGrid, PixelContent, is_averaged};
use super::means::{Cells, Columns, Means};
use super::span::Span;
use spinney_base::value::{Number, Rule, Sample, SampleType, Value, ValueType};
use spinney_base::{Progress, Result};
use spinney_engine::dataset::Dataset;
use spinney_engine::query::PixelGrid;

/// Bytes of cells that are averaged at a time, but at least one line of pixels. Cells then stay in
/// the processor's cache between being read and being summed.
const CACHED: usize = 1 << 18;

/// Reader of the rows of a window, unchanged or resampled.
pub(super) struct Sampler<'a> {
    pub(super) tree: &'a Dataset,
    pub(super) grid: OutputGrid,
    /// The number written for VOID.
    pub(super) fill: Number,
}

impl Sampler<'_> {
    /// Yields all pixels of the output with their validity flags, in bands of `rows` rows. Upright
    /// slices begin with the last row.
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

    /// Returns some rows of the output and the validity flag of each pixel.
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

    /// Replaces missing samples by the number for VOID, unless the tree stores that number already.
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

    /// Returns the cells in some rows of the level, and their validity flags.
    fn rows(&self, first: u64, end: u64) -> Result<(Vec<u8>, Vec<bool>)> {
        let (mut bytes, mut valid) = (Vec::new(), Vec::new());
        self.read(first, end, &mut bytes, Some(&mut valid))?;
        Ok((bytes, valid))
    }

    /// Reads the cells in some rows of the level, and their validity flags if a buffer for them is
    /// given. Overwrites both buffers.
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
            // VOID is a number here: an empty cell.
            Some(valid) if is_occupancy => {
                valid.fill(true);
                self.tree.window(self.grid.level, &bounds, self.fill, bytes, None)
            }
            valid => self.tree.window(self.grid.level, &bounds, self.fill, bytes, valid),
        }
    }

    /// Output rows that are rows of cells.
    fn copy(&self, row: u64, count: u64) -> Result<(Vec<u8>, Vec<bool>)> {
        let first = self.grid.source.min[self.grid.axes[1]] + row;
        self.rows(first, first + count)
    }

    /// Output rows whose pixels are area-weighted means of the cells that they cover, or the cells
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

    /// Whether cells under the pixels may be VOID.
    fn may_be_void(&self) -> Result<bool> {
        let OutputGrid { source, level, .. } = &self.grid;
        if self.tree.header().rule == Rule::Occupancy {
            return Ok(false);
        }
        // Checked for the whole raster: the file stores that, so no cells are read.
        Ok(!self.tree.extent_at(*level).contains(source)
            || self.tree.may_have_void(self.tree.header().extent_bounds())?)
    }

    /// The value written for VOID.
    fn void(&self) -> Value {
        self.tree.header().form.value.nearest_numbers(|_| self.fill)
    }

    /// The value that means are computed relative to: for 64-bit integers the minimum of the tree,
    /// otherwise 0. In trees of occupancy it is 0, since an empty cell is 0.
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

    /// Output rows whose pixels are exact means of the deepest cells.
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
                // In trees of occupancy VOID is a number: an empty cell.
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
    // Reversing all cells reverses the rows as well; reversing each row then restores its own
    // order.
    cells.reverse();
    cells.chunks_mut(width).for_each(<[T]>::reverse);
}

/// Writes the value for VOID to pixels without a value, for 64-bit integers: `f64` cannot hold all
/// of them exactly.
fn put_void(value: ValueType, void: Value, bytes: &mut [u8], valid: &[bool]) {
    if matches!(value.sample, SampleType::U64 | SampleType::I64) {
        let pixels = bytes.chunks_exact_mut(value.size()).zip(valid).filter(|(_, valid)| !**valid);
        pixels.for_each(|(pixel, _)| void.write(pixel));
    }
}

/// Appends numbers, which are relative to `base`, as samples of a type. Integers are rounded half
/// up and clamped to the range of the type.
fn push_numbers(sample: SampleType, base: Value, numbers: &[f64], bytes: &mut Vec<u8>) {
    // A cast truncates, which rounds down for numbers of at least 0; unsigned types have no others.
    // A call of `floor` would take longer than everything else here.
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

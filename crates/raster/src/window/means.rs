//! Area-weighted means of the cells that pixels cover. Rows of cells are summed first, then columns
//! of these sums.

use std::ops::Range;

use super::span::Span;
use spinney_base::value::{Sample, SampleType, Value, ValueType};

/// Cells of some rows, along all columns that pixels cover.
pub(super) struct Cells<'a> {
    pub(super) value: ValueType,
    /// Index of the first row.
    pub(super) first: u64,
    /// Cells per row.
    pub(super) width: usize,
    pub(super) bytes: &'a [u8],
    /// Validity flag of each cell; `None` if all cells have values.
    pub(super) valid: Option<&'a [bool]>,
    /// The value that means are relative to: see [`ValueType::samples_from`].
    pub(super) base: Value,
}

/// The columns of cells that each pixel of a line covers, in pixel order.
pub(super) struct Columns {
    pixels: Vec<Column>,
    /// Shares of the cells, of all pixels.
    shares: Vec<f64>,
}

/// The columns that one pixel covers: the first one, as index in a row of cells, and their shares.
struct Column {
    first: usize,
    shares: Range<usize>,
    /// Sum of the shares.
    weight: f64,
}

impl Columns {
    /// Computes the columns of spans. `first` is the number of the first cell in a row.
    pub(super) fn new(spans: &[Span], first: u64) -> Columns {
        let mut columns = Columns { pixels: Vec::with_capacity(spans.len()), shares: Vec::new() };
        for span in spans {
            let begin = columns.shares.len();
            columns.shares.extend((span.first..span.end).map(|cell| span.share(cell)));
            let weight = columns.shares[begin..].iter().sum();
            let shares = begin..columns.shares.len();
            columns.pixels.push(Column { first: (span.first - first) as usize, shares, weight });
        }
        columns
    }

    /// Number of pixels of a line.
    pub(super) fn len(&self) -> usize {
        self.pixels.len()
    }

    /// First column, shares, and sum of the shares of each pixel.
    fn pixels(&self) -> impl Iterator<Item = (usize, &[f64], f64)> {
        self.pixels.iter().map(|pixel| (pixel.first, &self.shares[pixel.shares.clone()], pixel.weight))
    }
}

/// Sums of the cells of some rows, per column and channel, and their weights.
#[derive(Default)]
pub(super) struct Means {
    sums: Vec<f64>,
    /// Empty if all samples have values: then all weights are the same.
    weights: Vec<f64>,
}

impl Means {
    /// Computes the means of all channels for the pixels of a line, and whether each pixel has a
    /// value. A channel without samples gets `none`, a pixel without samples gets `fill`.
    pub(super) fn line(
        &mut self,
        cells: &Cells<'_>,
        line: &Span,
        columns: &Columns,
        [none, fill]: [f64; 2],
        (means, valid): (&mut [f64], &mut [bool]),
    ) {
        let channels = usize::from(cells.value.channels);
        let length = cells.width * channels;
        let is_full = cells.valid.is_none() && !cells.value.is_masked();
        // Invariant: a cell's weight is the product of its shares along both axes. So rows can be
        // summed first along the whole band, and columns of each pixel after that. Sums of integers
        // with integer shares are exact in either order.
        self.sums.clear();
        self.sums.resize(length, 0.0);
        self.weights.clear();
        self.weights.resize(if is_full { 0 } else { length }, 0.0);
        let mut rows = 0.0;
        for row in line.first..line.end {
            let share = line.share(row);
            rows += share;
            self.add(cells, (row - cells.first) as usize, share);
        }
        let pixels = means.chunks_exact_mut(channels).zip(valid).zip(columns.pixels());
        for ((means, valid), (first, shares, weight)) in pixels {
            let columns = first * channels..(first + shares.len()) * channels;
            if is_full {
                let weight = rows * weight;
                across(shares, &self.sums[columns], means);
                means.iter_mut().for_each(|mean| *mean /= weight);
                *valid = true;
                continue;
            }
            let mut weights = [0.0; 4];
            across(shares, &self.sums[columns.clone()], means);
            across(shares, &self.weights[columns], &mut weights[..channels]);
            *valid = weights.iter().any(|weight| *weight > 0.0);
            let none = if *valid { none } else { fill };
            for (mean, weight) in means.iter_mut().zip(weights) {
                *mean = if weight > 0.0 { *mean / weight } else { none };
            }
        }
    }

    /// Adds a row of cells with the weight `share`.
    fn add(&mut self, cells: &Cells<'_>, row: usize, share: f64) {
        match cells.value.sample {
            SampleType::U8 => self.add_row(cells, row, share, |[byte]| f64::from(byte)),
            SampleType::U16 => self.add_row(cells, row, share, |bytes| u16::from_le_bytes(bytes).into()),
            SampleType::I16 => self.add_row(cells, row, share, |bytes| i16::from_le_bytes(bytes).into()),
            SampleType::U32 => self.add_row(cells, row, share, |bytes| u32::from_le_bytes(bytes).into()),
            SampleType::I32 => self.add_row(cells, row, share, |bytes| i32::from_le_bytes(bytes).into()),
            SampleType::F32 => self.add_row(cells, row, share, |bytes| f32::from_le_bytes(bytes).into()),
            SampleType::F64 => self.add_row(cells, row, share, f64::from_le_bytes),
            SampleType::I8 => self.add_row(cells, row, share, |bytes| i8::from_le_bytes(bytes).into()),
            SampleType::U64 => {
                let base = u64::read(&cells.base.to_bytes());
                self.add_row(cells, row, share, |bytes| u64::from_le_bytes(bytes).relative_to(base));
            }
            SampleType::I64 => {
                let base = i64::read(&cells.base.to_bytes());
                self.add_row(cells, row, share, |bytes| i64::from_le_bytes(bytes).relative_to(base));
            }
        }
    }

    #[inline]
    fn add_row<const N: usize>(
        &mut self,
        cells: &Cells<'_>,
        row: usize,
        share: f64,
        number: impl Fn([u8; N]) -> f64,
    ) {
        let Means { sums, weights } = self;
        let channels = usize::from(cells.value.channels);
        let bytes = &cells.bytes[row * cells.width * channels * N..][..cells.width * channels * N];
        let (samples, _) = bytes.as_chunks::<N>();
        if weights.is_empty() {
            sums.iter_mut().zip(samples).for_each(|(sum, sample)| *sum += share * number(*sample));
            return;
        }
        let valid = cells.valid.map(|valid| &valid[row * cells.width..][..cells.width]);
        let values = bytes.chunks_exact(channels * N).zip(samples.chunks_exact(channels));
        let columns = sums.chunks_exact_mut(channels).zip(weights.chunks_exact_mut(channels));
        for (column, ((value, samples), (sums, weights))) in values.zip(columns).enumerate() {
            if valid.is_some_and(|valid| !valid[column]) {
                continue;
            }
            // Per channel, since single samples may be missing.
            let present = cells.value.present(Value::from_bytes(value));
            for channel in (0..channels).filter(|channel| present[*channel]) {
                sums[channel] += share * number(samples[channel]);
                weights[channel] += share;
            }
        }
    }
}

/// Weighted sum of each channel over some columns.
#[inline]
fn across(shares: &[f64], numbers: &[f64], sums: &mut [f64]) {
    if let [sum] = sums {
        *sum = shares.iter().zip(numbers).map(|(share, number)| share * number).sum();
        return;
    }
    sums.fill(0.0);
    for (share, numbers) in shares.iter().zip(numbers.chunks_exact(sums.len())) {
        sums.iter_mut().zip(numbers).for_each(|(sum, number)| *sum += share * number);
    }
}

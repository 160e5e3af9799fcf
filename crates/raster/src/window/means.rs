//! Means of the cells that pixels cover, weighted by area: rows of cells are added up first, then columns of what they make.

use super::span::Span;
use spinney_base::value::{SampleType, Value, ValueType};

/// Cells of some rows, all along the columns that pixels cover.
pub(super) struct Cells<'a> {
    pub(super) value: ValueType,
    /// The first row and the first column.
    pub(super) first: [u64; 2],
    /// Cells of a row.
    pub(super) width: usize,
    pub(super) bytes: &'a [u8],
    /// Whether each cell has a value.
    pub(super) valid: &'a [bool],
}

/// Sums for each column and channel of the cells of some rows, and their weights.
pub(super) struct Means<'a> {
    cells: Cells<'a>,
    /// Whether all samples count.
    is_full: bool,
    sums: Vec<f64>,
    /// Not used if all samples count: then they are all the same.
    weights: Vec<f64>,
}

impl<'a> Means<'a> {
    pub(super) fn new(cells: Cells<'a>) -> Means<'a> {
        let length = cells.width * usize::from(cells.value.channels);
        let is_full = cells.value.all_missing().is_none() && cells.valid.iter().all(|valid| *valid);
        Means {
            is_full,
            sums: vec![0.0; length],
            weights: vec![0.0; if is_full { 0 } else { length }],
            cells,
        }
    }

    /// Hands out the means of each channel, `None` where there is none, of the pixels of a line, one after the other; `columns` are
    /// the pixels' spans with the shares of their cells.
    pub(super) fn line(
        &mut self,
        line: &Span,
        columns: &[(Span, Vec<f64>)],
        each: &mut dyn FnMut([Option<f64>; 4]),
    ) {
        let channels = usize::from(self.cells.value.channels);
        let [first_row, first_column] = self.cells.first;
        // Invariant: a cell's weight is the product of its shares along both axes. So the rows can be added up first, all along the
        // band, and the columns of each pixel then; sums of whole numbers by whole shares are exact in either order.
        self.sums.fill(0.0);
        self.weights.fill(0.0);
        let mut rows = 0.0;
        for row in line.first..line.end {
            let share = line.share(row);
            rows += share;
            self.add((row - first_row) as usize, share);
        }
        for (column, shares) in columns {
            let begin = (column.first - first_column) as usize * channels;
            let (mut sums, mut weights) = ([0.0; 4], [0.0; 4]);
            if self.is_full {
                weights[..channels].fill(rows * shares.iter().sum::<f64>());
            } else {
                for (share, own) in shares.iter().zip(self.weights[begin..].chunks_exact(channels)) {
                    weights.iter_mut().zip(own).for_each(|(weight, own)| *weight += share * own);
                }
            }
            for (share, own) in shares.iter().zip(self.sums[begin..].chunks_exact(channels)) {
                sums.iter_mut().zip(own).for_each(|(sum, own)| *sum += share * own);
            }
            each(std::array::from_fn(|channel| {
                (weights[channel] > 0.0).then(|| sums[channel] / weights[channel])
            }));
        }
    }

    /// Adds a row of cells, each of which counts for a share.
    fn add(&mut self, row: usize, share: f64) {
        match self.cells.value.sample {
            SampleType::U8 => self.add_row(row, share, |[byte]| f64::from(byte)),
            SampleType::U16 => self.add_row(row, share, |bytes| u16::from_le_bytes(bytes).into()),
            SampleType::I16 => self.add_row(row, share, |bytes| i16::from_le_bytes(bytes).into()),
            SampleType::U32 => self.add_row(row, share, |bytes| u32::from_le_bytes(bytes).into()),
            SampleType::I32 => self.add_row(row, share, |bytes| i32::from_le_bytes(bytes).into()),
            SampleType::F32 => self.add_row(row, share, |bytes| f32::from_le_bytes(bytes).into()),
            SampleType::F64 => self.add_row(row, share, f64::from_le_bytes),
        }
    }

    #[inline]
    fn add_row<const N: usize>(&mut self, row: usize, share: f64, number: impl Fn([u8; N]) -> f64) {
        let Means { cells, is_full, sums, weights } = self;
        let channels = usize::from(cells.value.channels);
        let bytes = &cells.bytes[row * cells.width * channels * N..][..cells.width * channels * N];
        let (samples, _) = bytes.as_chunks::<N>();
        if *is_full {
            sums.iter_mut().zip(samples).for_each(|(sum, sample)| *sum += share * number(*sample));
            return;
        }
        let valid = &cells.valid[row * cells.width..][..cells.width];
        let values = bytes.chunks_exact(channels * N).zip(samples.chunks_exact(channels));
        let columns = sums.chunks_exact_mut(channels).zip(weights.chunks_exact_mut(channels));
        for (((value, samples), (sums, weights)), _) in
            values.zip(columns).zip(valid).filter(|(_, valid)| **valid)
        {
            // (Of each channel, since its sample may be missing.)
            let present = cells.value.present(Value::from_bytes(value));
            for channel in (0..channels).filter(|channel| present[*channel]) {
                sums[channel] += share * number(samples[channel]);
                weights[channel] += share;
            }
        }
    }
}

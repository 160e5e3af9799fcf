//! Statistics of partial cells, and of full and partial cells combined.

use std::collections::{BTreeMap, HashMap};

use zerocopy::IntoBytes;

use super::AddDense;
use super::cells::{in_cells, in_shares};
use super::request::{ZoneChannel, ZoneStatistics};
use crate::store::records::dense::{DenseBlock, DenseRows};
use crate::store::records::{Record, RecordLayout, with_record_type};
use spinney_base::value::{
    DoubleDouble, Number, Sample, TripleDouble, Value, ValueType, ZoneStats, with_sample_type,
};
use spinney_base::{TreeType, sort};
use spinney_overlay::FULL_SHARE;

/// Statistics of partial cells.
pub(super) struct PartialCellSums {
    value_type: ValueType,
    channels: [ChannelSums; 4],
    /// Sum of the shares of all cells.
    shares: u128,
    classes: ClassShares,
    /// Converts a sample to `f64` for computing.
    number: fn(&[u8]) -> f64,
    /// Converts a sample exactly.
    exact: fn(&[u8]) -> Number,
    dense: AddDense<PartialCellSums>,
}

/// Shares of each class. (For one channel, all other statistics follow from them.)
enum ClassShares {
    /// Not counted.
    None,
    /// Values of one byte.
    Bytes(Box<[u128; 256]>),
    Values(HashMap<Value, u128>),
}

/// Sums of a channel's samples, weighted by their shares.
#[derive(Clone, Copy)]
struct ChannelSums {
    shares: u128,
    /// Exact sum of integers of up to 32 bits.
    exact: i128,
    /// Sum of other samples, and sum of squares of all samples.
    sum: TripleDouble,
    squares: TripleDouble,
    min: Number,
    max: Number,
    /// Extremes as `f64`, for a fast comparison.
    least: f64,
    most: f64,
}

impl Default for ChannelSums {
    fn default() -> Self {
        let (least, most) = (f64::INFINITY, f64::NEG_INFINITY);
        let (sum, squares) = (TripleDouble::default(), TripleDouble::default());
        ChannelSums { shares: 0, exact: 0, sum, squares, min: least.into(), max: most.into(), least, most }
    }
}

/// Converts shares to a factor.
fn double_of(shares: u128) -> DoubleDouble {
    match u64::try_from(shares) {
        Ok(shares) if shares < 1 << f64::MANTISSA_DIGITS => DoubleDouble::from(shares as f64),
        _ => DoubleDouble::from(shares as i128),
    }
}

impl ChannelSums {
    /// Extends the extremes by a sample. The extremes are exact, but most samples do not need an
    /// exact comparison.
    #[inline]
    fn widen(&mut self, number: f64, exact: impl FnOnce() -> Number) {
        if number <= self.least || number >= self.most {
            let exact = exact();
            (self.min, self.max) = (self.min.min(exact), self.max.max(exact));
            (self.least, self.most) = (self.least.min(number), self.most.max(number));
        }
    }
}

impl PartialCellSums {
    /// Creates empty statistics for trees of `form`.
    pub(super) fn new(form: TreeType, counts_classes: bool) -> PartialCellSums {
        let value_type = form.value;
        let classes = match (counts_classes, value_type.size()) {
            (false, _) => ClassShares::None,
            (true, 1) => ClassShares::Bytes(Box::new([0; 256])),
            (true, _) => ClassShares::Values(HashMap::new()),
        };
        PartialCellSums {
            value_type,
            channels: [ChannelSums::default(); 4],
            shares: 0,
            classes,
            number: with_sample_type!(value_type.sample, S => number_of::<S>),
            exact: with_sample_type!(value_type.sample, S => exact_of::<S>),
            dense: with_record_type!(RecordLayout::new(form), R => add_dense::<R>),
        }
    }

    /// Adds cells of a value with a total of `shares`.
    #[inline]
    pub(super) fn block(&mut self, value: Value, shares: u128) {
        self.add(&value.to_bytes()[..self.value_type.size()], shares);
    }

    /// Adds the cells of a dense block in a box, each with the same share.
    pub(super) fn dense(&mut self, block: &DenseBlock<'_>, part: ([usize; 3], [usize; 3]), share: u64) {
        (self.dense)(self, block, part, share);
    }

    /// Adds cells of a value, given its bytes.
    #[inline]
    fn add(&mut self, bytes: &[u8], shares: u128) {
        self.shares += shares;
        match &mut self.classes {
            ClassShares::None => self.measure(bytes, shares),
            ClassShares::Bytes(classes) => classes[usize::from(bytes[0])] += shares,
            ClassShares::Values(classes) => {
                *classes.entry(Value::from_bytes(bytes)).or_default() += shares;
            }
        }
    }

    #[inline]
    fn measure(&mut self, bytes: &[u8], shares: u128) {
        let sample_type = self.value_type.sample;
        let is_masked = self.value_type.is_masked();
        let present = if is_masked { self.value_type.present(Value::from_bytes(bytes)) } else { [true; 4] };
        let weight = double_of(shares);
        let samples = self.channels.iter_mut().zip(bytes.chunks_exact(sample_type.size())).zip(present);
        for ((channel, sample), _) in samples.filter(|(_, is_there)| *is_there) {
            let number = (self.number)(sample);
            channel.shares += shares;
            if sample_type.is_float() {
                channel.sum = channel.sum + TripleDouble::from(number) * weight;
                channel.squares =
                    channel.squares + TripleDouble::from(DoubleDouble::product(number, number)) * weight;
            } else if let Some(integer) = (self.exact)(sample).to_integer() {
                let number = DoubleDouble::from(integer);
                if sample_type.is_wide_integer() {
                    channel.sum = channel.sum + TripleDouble::from(number) * weight;
                } else {
                    // Invariant: a sample of 32 bits, a share of 40 bits and a cell count of 55
                    // bits take at most 127 bits together.
                    channel.exact = channel.exact.wrapping_add(integer * shares as i128);
                }
                channel.squares = channel.squares + TripleDouble::from(number) * number * weight;
            }
            channel.widen(number, || (self.exact)(sample));
        }
    }

    /// Combines partial and full cells. `all` is the sum of shares of the zone's cells within the
    /// raster.
    pub(super) fn with(mut self, whole: &ZoneStats, all: u128) -> ZoneStatistics {
        let value_type = self.value_type;
        let mut classes: Vec<(Value, u128)> = match std::mem::replace(&mut self.classes, ClassShares::None) {
            ClassShares::None => Vec::new(),
            ClassShares::Bytes(classes) => {
                let counted = (0..=u8::MAX).zip(*classes).filter(|(_, shares)| *shares > 0);
                counted.map(|(byte, shares)| (Value::from([byte]), shares)).collect()
            }
            ClassShares::Values(classes) => classes.into_iter().collect(),
        };
        // (Rounded sums depend on the order, so the order is fixed.)
        sort::by(&mut classes, &mut |(a, _), (b, _)| value_type.order(*a, *b));
        for (value, shares) in &classes {
            self.measure(&value.to_bytes()[..value_type.size()], *shares);
        }
        let mut by_class: BTreeMap<Number, u128> = BTreeMap::new();
        if value_type.channels == 1 {
            let counted = whole.classes.iter().map(|(value, cells)| (*value, in_shares((*cells, 0))));
            for (value, shares) in counted.chain(classes) {
                *by_class.entry(value_type.first_number(value)).or_default() += shares;
            }
        }
        let shares = self.shares + in_shares((whole.cells, 0));
        let channels = if shares > 0 { usize::from(value_type.channels) } else { 0 };
        ZoneStatistics {
            cells: in_cells(shares),
            void_cells: in_cells(all.saturating_sub(shares)),
            outside_cells: 0.0,
            channels: (0..channels).map(|index| self.channel(whole, index)).collect(),
            classes: by_class.into_iter().map(|(class, shares)| (class, in_cells(shares))).collect(),
        }
    }

    /// Returns a channel's statistics, of partial and full cells combined.
    fn channel(&self, whole: &ZoneStats, index: usize) -> ZoneChannel {
        let parts = &self.channels[index];
        let cells = whole.present[index];
        let shares = parts.shares + in_shares((cells, 0));
        if shares == 0 {
            let (none, mean) = (Number::NAN, f64::NAN);
            return ZoneChannel {
                min: none,
                max: none,
                mean,
                standard_deviation: mean,
                ..ZoneChannel::default()
            };
        }
        let (mut min, mut max) = (parts.min, parts.max);
        if cells > 0 {
            let of = |value: Value| self.value_type.numbers(value)[index];
            (min, max) = (min.min(of(whole.min)), max.max(of(whole.max)));
        }
        let full = DoubleDouble::from(FULL_SHARE as f64);
        // (`FULL_SHARE` is a power of two, so the scaling is exact.)
        let one = 1.0 / FULL_SHARE as f64;
        let sum = whole.sum.triple(index) + (parts.sum + TripleDouble::from(parts.exact)) * one;
        let squares = whole.squares.triple(index) + parts.squares * one;
        let weight = double_of(shares) / full;
        let mean = DoubleDouble { high: sum.high, low: sum.middle } / weight;
        // (Rounding must not cause a deviation of equal samples.)
        let variance =
            if min == max && min.is_finite() { 0.0 } else { TripleDouble::variance(sum, squares, weight) };
        ZoneChannel {
            cells: in_cells(shares),
            min,
            max,
            sum: sum.high,
            mean: if min == max && min.is_finite() { min.to_f64() } else { mean.high },
            standard_deviation: variance.sqrt(),
            values: None,
        }
    }
}

fn number_of<S: Sample>(bytes: &[u8]) -> f64 {
    S::read(bytes).to_f64()
}

fn exact_of<S: Sample>(bytes: &[u8]) -> Number {
    S::read(bytes).to_number()
}

fn add_dense<R: Record>(
    parts: &mut PartialCellSums,
    block: &DenseBlock<'_>,
    part: ([usize; 3], [usize; 3]),
    share: u64,
) {
    block.each_leaf_in::<R>(part, &mut |bytes| parts.add(bytes.as_bytes(), share.into()));
}

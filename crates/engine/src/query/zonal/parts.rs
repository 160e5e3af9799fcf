//! Statistics of parts of cells, and of whole ones and parts together.

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

/// Statistics of parts of cells.
pub(super) struct Parts {
    value_type: ValueType,
    channels: [ChannelParts; 4],
    /// Shares of all cells.
    shares: u128,
    classes: PartsOfClasses,
    /// A sample to compute with, and exactly.
    number: fn(&[u8]) -> f64,
    exact: fn(&[u8]) -> Number,
    dense: AddDense<Parts>,
}

/// Shares of each class. (All other statistics of one channel follow from them.)
enum PartsOfClasses {
    /// They are not counted.
    None,
    /// Of values of one byte.
    Bytes(Box<[u128; 256]>),
    Values(HashMap<Value, u128>),
}

/// Sums of a channel's samples, each multiplied by its share.
#[derive(Clone, Copy)]
struct ChannelParts {
    shares: u128,
    /// The sum of integers of up to 32 bits, exactly.
    exact: i128,
    /// The sum of other samples, and of the squares of all.
    sum: TripleDouble,
    squares: TripleDouble,
    min: Number,
    max: Number,
    /// The extremes to compare with.
    least: f64,
    most: f64,
}

impl Default for ChannelParts {
    fn default() -> Self {
        let (least, most) = (f64::INFINITY, f64::NEG_INFINITY);
        let (sum, squares) = (TripleDouble::default(), TripleDouble::default());
        ChannelParts { shares: 0, exact: 0, sum, squares, min: least.into(), max: most.into(), least, most }
    }
}

/// A number of shares to multiply with.
fn double_of(shares: u128) -> DoubleDouble {
    match u64::try_from(shares) {
        Ok(shares) if shares < 1 << f64::MANTISSA_DIGITS => DoubleDouble::from(shares as f64),
        _ => DoubleDouble::from(shares as i128),
    }
}

impl ChannelParts {
    /// Adds a sample to the extremes. They are exact, which few samples need to be compared for.
    #[inline]
    fn widen(&mut self, number: f64, exact: impl FnOnce() -> Number) {
        if number <= self.least || number >= self.most {
            let exact = exact();
            (self.min, self.max) = (self.min.min(exact), self.max.max(exact));
            (self.least, self.most) = (self.least.min(number), self.most.max(number));
        }
    }
}

impl Parts {
    /// Nothing yet, of trees of a form.
    pub(super) fn new(form: TreeType, counts_classes: bool) -> Parts {
        let value_type = form.value;
        let classes = match (counts_classes, value_type.size()) {
            (false, _) => PartsOfClasses::None,
            (true, 1) => PartsOfClasses::Bytes(Box::new([0; 256])),
            (true, _) => PartsOfClasses::Values(HashMap::new()),
        };
        Parts {
            value_type,
            channels: [ChannelParts::default(); 4],
            shares: 0,
            classes,
            number: with_sample_type!(value_type.sample, S => number_of::<S>),
            exact: with_sample_type!(value_type.sample, S => exact_of::<S>),
            dense: with_record_type!(RecordLayout::new(form), R => add_dense::<R>),
        }
    }

    /// Adds cells of a value, by the sum of their shares.
    #[inline]
    pub(super) fn block(&mut self, value: Value, shares: u128) {
        self.add(&value.to_bytes()[..self.value_type.size()], shares);
    }

    /// Adds the cells of a dense block in a box, each with such a share of it.
    pub(super) fn dense(&mut self, block: &DenseBlock<'_>, part: ([usize; 3], [usize; 3]), share: u64) {
        (self.dense)(self, block, part, share);
    }

    /// Adds cells of a value, given its bytes.
    #[inline]
    fn add(&mut self, bytes: &[u8], shares: u128) {
        self.shares += shares;
        match &mut self.classes {
            PartsOfClasses::None => self.measure(bytes, shares),
            PartsOfClasses::Bytes(classes) => classes[usize::from(bytes[0])] += shares,
            PartsOfClasses::Values(classes) => {
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
                    // Invariant: 32 bits of a sample, 40 of a share and 55 of a number of cells are less than 127.
                    channel.exact = channel.exact.wrapping_add(integer * shares as i128);
                }
                channel.squares = channel.squares + TripleDouble::from(number) * number * weight;
            }
            channel.widen(number, || (self.exact)(sample));
        }
    }

    /// These parts and whole cells together, of a zone that has so many shares of cells within the picture.
    pub(super) fn with(mut self, whole: &ZoneStats, all: u128) -> ZoneStatistics {
        let value_type = self.value_type;
        let mut classes: Vec<(Value, u128)> = match std::mem::replace(&mut self.classes, PartsOfClasses::None)
        {
            PartsOfClasses::None => Vec::new(),
            PartsOfClasses::Bytes(classes) => {
                let counted = (0..=u8::MAX).zip(*classes).filter(|(_, shares)| *shares > 0);
                counted.map(|(byte, shares)| (Value::from([byte]), shares)).collect()
            }
            PartsOfClasses::Values(classes) => classes.into_iter().collect(),
        };
        // (Sums that are rounded are those of one order.)
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

    /// A channel's statistics, of parts and whole cells together.
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
        // (Shares are parts of a power of two, so that no digit changes.)
        let one = 1.0 / FULL_SHARE as f64;
        let sum = whole.sum.triple(index) + (parts.sum + TripleDouble::from(parts.exact)) * one;
        let squares = whole.squares.triple(index) + parts.squares * one;
        let weight = double_of(shares) / full;
        let mean = DoubleDouble { high: sum.high, low: sum.middle } / weight;
        // (Rounding must not make a deviation of nothing.)
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
    parts: &mut Parts,
    block: &DenseBlock<'_>,
    part: ([usize; 3], [usize; 3]),
    share: u64,
) {
    block.each_leaf_in::<R>(part, &mut |bytes| parts.add(bytes.as_bytes(), share.into()));
}

//! Statistics of parts of cells, and of whole ones and parts together.

use std::collections::{BTreeMap, HashMap};

use zerocopy::IntoBytes;

use super::super::stats::summary;
use super::request::{ZoneChannel, ZoneStatistics};
use super::{AREA_ROUNDING, AddDense};
use crate::store::records::dense::{DenseBlock, DenseRows};
use crate::store::records::{Record, RecordLayout, with_record_type};
use spinney_base::TreeType;
use spinney_base::value::{Number, Sample, Value, ValueType, ZoneStats, with_sample_type};

/// Statistics of parts of cells.
pub(super) struct Parts {
    value_type: ValueType,
    channels: [Moments; 4],
    cells: f64,
    classes: PartsOfClasses,
    /// A sample to compute with, and exactly.
    number: fn(&[u8]) -> f64,
    exact: fn(&[u8]) -> Number,
    dense: AddDense<Parts>,
}

/// Cells of each class. (Those of one channel tell everything else, in the end.)
enum PartsOfClasses {
    /// They are not counted.
    None,
    /// Of values of one byte.
    Bytes(Box<[f64; 256]>),
    Values(HashMap<Value, f64>),
}

/// Mean and spread of weighted numbers, as they come (West, 1979).
#[derive(Clone, Copy)]
struct Moments {
    weight: f64,
    mean: f64,
    squares: f64,
    min: Number,
    max: Number,
    /// The extremes to compare with.
    least: f64,
    most: f64,
}

impl Default for Moments {
    fn default() -> Self {
        let (least, most) = (f64::INFINITY, f64::NEG_INFINITY);
        Moments { weight: 0.0, mean: 0.0, squares: 0.0, min: least.into(), max: most.into(), least, most }
    }
}

impl Moments {
    /// Adds a number to the mean and the spread.
    #[inline]
    fn add_number(&mut self, number: f64, weight: f64) {
        self.weight += weight;
        let away = number - self.mean;
        let step = away * (weight / self.weight);
        self.squares += weight * away * (away - step);
        self.mean += step;
    }

    /// Adds a sample to the extremes. They are exact, which few samples need to be compared for.
    #[inline]
    fn widen(&mut self, number: f64, exact: impl FnOnce() -> Number) {
        if number <= self.least || number >= self.most {
            let exact = exact();
            (self.min, self.max) = (self.min.min(exact), self.max.max(exact));
            (self.least, self.most) = (self.least.min(number), self.most.max(number));
        }
    }

    fn add(&mut self, other: Moments) {
        let weight = self.weight + other.weight;
        if weight <= 0.0 {
            return;
        }
        let away = other.mean - self.mean;
        self.squares += other.squares + away * away * self.weight * other.weight / weight;
        self.mean += away * other.weight / weight;
        self.weight = weight;
        (self.min, self.max) = (self.min.min(other.min), self.max.max(other.max));
    }
}

impl Parts {
    /// Nothing yet, of trees of a form.
    pub(super) fn new(form: TreeType, counts_classes: bool) -> Parts {
        let value_type = form.value;
        let classes = match (counts_classes, value_type.size()) {
            (false, _) => PartsOfClasses::None,
            (true, 1) => PartsOfClasses::Bytes(Box::new([0.0; 256])),
            (true, _) => PartsOfClasses::Values(HashMap::new()),
        };
        Parts {
            value_type,
            channels: [Moments::default(); 4],
            cells: 0.0,
            classes,
            number: with_sample_type!(value_type.sample, S => number_of::<S>),
            exact: with_sample_type!(value_type.sample, S => exact_of::<S>),
            dense: with_record_type!(RecordLayout::new(form), R => add_dense::<R>),
        }
    }

    /// Adds cells of a value.
    #[inline]
    pub(super) fn block(&mut self, value: Value, weight: f64) {
        self.add(&value.to_bytes()[..self.value_type.size()], weight);
    }

    /// Adds the cells of a dense block in a box, each as such a share of it.
    pub(super) fn dense(&mut self, block: &DenseBlock<'_>, part: ([usize; 3], [usize; 3]), share: f64) {
        (self.dense)(self, block, part, share);
    }

    /// Adds cells of a value, given its bytes.
    #[inline]
    fn add(&mut self, bytes: &[u8], weight: f64) {
        self.cells += weight;
        match &mut self.classes {
            PartsOfClasses::None => self.measure(bytes, weight),
            PartsOfClasses::Bytes(classes) => classes[usize::from(bytes[0])] += weight,
            PartsOfClasses::Values(classes) => {
                *classes.entry(Value::from_bytes(bytes)).or_default() += weight;
            }
        }
    }

    #[inline]
    fn measure(&mut self, bytes: &[u8], weight: f64) {
        let size = self.value_type.sample.size();
        let is_masked = self.value_type.is_masked();
        let present = if is_masked { self.value_type.present(Value::from_bytes(bytes)) } else { [true; 4] };
        let samples = self.channels.iter_mut().zip(bytes.chunks_exact(size)).zip(present);
        for ((channel, sample), _) in samples.filter(|(_, is_there)| *is_there) {
            let number = (self.number)(sample);
            channel.add_number(number, weight);
            channel.widen(number, || (self.exact)(sample));
        }
    }

    /// These parts and whole cells together, of a zone of so many cells within the picture.
    pub(super) fn with(mut self, whole: &ZoneStats, all: f64) -> ZoneStatistics {
        let value_type = self.value_type;
        let classes: Vec<(Value, f64)> = match std::mem::replace(&mut self.classes, PartsOfClasses::None) {
            PartsOfClasses::None => Vec::new(),
            PartsOfClasses::Bytes(classes) => {
                let counted = (0..=u8::MAX).zip(*classes).filter(|(_, cells)| *cells > 0.0);
                counted.map(|(byte, cells)| (Value::from([byte]), cells)).collect()
            }
            PartsOfClasses::Values(classes) => classes.into_iter().collect(),
        };
        for (value, cells) in &classes {
            self.measure(&value.to_bytes()[..value_type.size()], *cells);
        }
        let summary = summary(whole, 0, 0);
        let mut told = BTreeMap::new();
        let counted = summary.classes.iter().map(|(class, cells)| (*class, *cells as f64));
        let measured = classes.iter().filter(|_| value_type.channels == 1);
        let measured = measured.map(|(value, cells)| (value_type.first_number(*value), *cells));
        counted.chain(measured).for_each(|(class, cells)| *told.entry(class).or_insert(0.0) += cells);
        let cells = self.cells + summary.cells as f64;
        let channel = |(index, parts): (usize, &Moments)| {
            let mut moments = *parts;
            // (Of whole cells alone the sum is as exact as the tally's.)
            let sum = whole.sum.number(index) + parts.mean * parts.weight;
            if let Some(whole) = summary.channels.get(index).filter(|whole| whole.cells > 0) {
                let weight = whole.cells as f64;
                moments.add(Moments {
                    weight,
                    mean: whole.mean,
                    squares: whole.standard_deviation * whole.standard_deviation * weight,
                    min: whole.min,
                    max: whole.max,
                    ..Moments::default()
                });
            }
            let Moments { weight, mean, squares, min, max, .. } = moments;
            if weight <= 0.0 {
                let (none, mean) = (Number::NAN, f64::NAN);
                return ZoneChannel {
                    min: none,
                    max: none,
                    mean,
                    standard_deviation: mean,
                    ..ZoneChannel::default()
                };
            }
            let standard_deviation = (squares / weight).max(0.0).sqrt();
            ZoneChannel { cells: weight, min, max, sum, mean, standard_deviation, values: None }
        };
        let channels = if cells > 0.0 { usize::from(value_type.channels) } else { 0 };
        ZoneStatistics {
            cells,
            // (Sums of as many shares as a zone has cells at its border are off by less than that: what rounding leaves of nothing is nothing.)
            void_cells: if all - cells > AREA_ROUNDING * all { all - cells } else { 0.0 },
            outside_cells: 0.0,
            channels: self.channels[..channels].iter().enumerate().map(channel).collect(),
            classes: told.into_iter().collect(),
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
    share: f64,
) {
    block.each_leaf_in::<R>(part, &mut |bytes| parts.add(bytes.as_bytes(), share));
}

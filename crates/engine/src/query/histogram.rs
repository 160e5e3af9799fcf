//! Histograms of any box. Zones whose values are all in one bin are counted as a whole.

use zerocopy::IntoBytes;

use super::count::{CountSubtree, number_of};
use super::folded::walk_folded;
use super::walk::{Visitor, Walked, Zone, ended, walk, walk_source};
use crate::store::autumnal::Autumnal;
use crate::store::goblin::Goblin;
use crate::store::records::dense::{DenseBlock, DenseRows};
use crate::store::records::subtree::{BadSkip, each_leaf};
use crate::store::records::{Record, RecordLayout, with_form_type, with_record_type};
use crate::tree::Source;
use spinney_base::TreeType;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{Native, Sample, Value, ValueType};
use spinney_base::{Progress, Result};

impl Goblin {
    /// Counts the cells of a box whose first channel is in each of `bins` equal intervals of `low
    /// ..= high`.
    ///
    /// # Errors
    /// If the file is corrupt there, or on cancellation.
    pub fn histogram(
        &self,
        bounds: &Bounds,
        low: f64,
        high: f64,
        bins: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<u64>> {
        let mut histogram = Histogram::new(self.header().form, (low, high), bins, progress);
        ended(walk(self, bounds, &mut histogram))?;
        Ok(histogram.bins.cells)
    }
}

/// [`Goblin::histogram`] of any source.
pub(crate) fn source_histogram<S: Source>(
    source: &S,
    bounds: &Bounds,
    range: (f64, f64),
    bins: usize,
    progress: &dyn Progress,
) -> Result<Vec<u64>> {
    let mut histogram = Histogram::new(source.form(), range, bins, progress);
    ended(walk_source(source, bounds, &mut histogram))?;
    Ok(histogram.bins.cells)
}

/// [`Goblin::histogram`] of an Autumnal file, whose records may represent any number of nodes.
pub(crate) fn autumnal_histogram(
    file: &Autumnal,
    bounds: &Bounds,
    range: (f64, f64),
    bins: usize,
    progress: &dyn Progress,
) -> Result<Vec<u64>> {
    if !file.is_folded()? {
        return source_histogram(file, bounds, range, bins, progress);
    }
    let mut histogram = Histogram::new(file.form(), range, bins, progress);
    walk_folded(file, bounds, &mut histogram)?;
    Ok(histogram.bins.cells)
}

/// Cell counts by equal intervals of a range. Numbers outside of the range count for the first or
/// the last interval.
struct Bins {
    low: f64,
    /// Bins per unit.
    scale: f64,
    /// The value type, if samples can be missing. Values without the first sample belong to no bin.
    masked: Option<ValueType>,
    cells: Vec<u64>,
}

impl Bins {
    /// Returns the index of the bin that contains a number.
    #[inline]
    fn bin(&self, number: f64) -> usize {
        let bin = (number - self.low) * self.scale;
        (bin.max(0.0) as usize).min(self.cells.len() - 1)
    }

    /// Counts cells of a value, given its bytes and first number.
    #[inline]
    fn add(&mut self, bytes: &[u8], number: f64, cells: u64) {
        if let Some(value_type) = self.masked
            && !value_type.mask.present(value_type.sample.size(), &bytes[..value_type.size()])[0]
        {
            return;
        }
        let bin = self.bin(number);
        self.cells[bin] += cells;
    }
}

struct Histogram<'a> {
    form: TreeType,
    bins: Bins,
    /// Returns the first sample of a value.
    number: fn(Value) -> f64,
    subtree: CountSubtree<Bins>,
    progress: &'a dyn Progress,
}

impl Histogram<'_> {
    fn new(form: TreeType, (low, high): (f64, f64), bins: usize, progress: &dyn Progress) -> Histogram<'_> {
        let cells = vec![0; bins.max(1)];
        let masked = Some(form.value).filter(|value_type| value_type.is_masked());
        Histogram {
            form,
            bins: Bins { low, scale: cells.len() as f64 / (high - low), masked, cells },
            number: number_of(form.value),
            subtree: with_form_type!(form, V, R => bin_subtree::<<V as Native>::Sample, R>),
            progress,
        }
    }
}

impl Visitor for Histogram<'_> {
    fn zone(&mut self, _: Code, zone: &dyn Zone) -> Walked<bool> {
        let zone = zone.tally()?;
        let [first, last] = [zone.min, zone.max].map(|value| self.bins.bin((self.number)(value)));
        if first == last {
            self.bins.cells[first] += zone.present[0];
        }
        Ok(first == last)
    }

    #[inline]
    fn block(&mut self, _: Code, value: Option<Value>, cells: u64, _: Option<&Bounds>) -> Walked {
        if let Some(value) = value {
            self.bins.add(&value.to_bytes(), (self.number)(value), cells);
        }
        Ok(())
    }

    fn subtree(&mut self, _: Code, records: &[u8], levels: u8) -> Option<Result<(), BadSkip>> {
        Some((self.subtree)(&mut self.bins, records, levels))
    }

    fn dense(&mut self, _: Code, block: &DenseBlock<'_>, part: ([usize; 3], [usize; 3])) -> bool {
        let Histogram { form, bins, number, .. } = self;
        with_record_type!(RecordLayout::new(*form), R => {
            block.each_leaf_in::<R>(part, &mut |bytes| {
                bins.add(bytes.as_bytes(), number(Value::from_bytes(bytes.as_bytes())), 1);
            });
        });
        true
    }

    fn leave(&mut self, _: Code) -> Walked {
        Ok(self.progress.check()?)
    }
}

fn bin_subtree<S: Sample, R: Record>(bins: &mut Bins, records: &[u8], levels: u8) -> Result<(), BadSkip> {
    each_leaf(R::of(records), levels, |bytes, cells| {
        bins.add(bytes.as_bytes(), S::read(bytes.as_bytes()).to_f64(), cells);
    })
}

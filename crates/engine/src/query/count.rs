//! Counts, sums and extremes of the values in a box.
//!
//! A query selects its counter once, by value type and fan-out, and then calls it through pointers:
//! single blocks one by one, and whole subtrees at once, whose leaves are visited by kernels.

use zerocopy::{FromBytes, IntoBytes};

use super::walk::Zone;
use crate::store::records::dense::{DenseBlock, DenseRows};
use crate::store::records::subtree::{BadSkip, LeafOrBlock, each_leaf, each_leaf_or_block};
use crate::store::records::{Record, RecordLayout, with_form_type, with_record_type};
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::value::{
    Native, Number, Sample, Value, ValueType, ZoneStats, erase, native, with_sample_type,
};

/// Kernel that passes all leaves of a subtree to a `T`, given the subtree's records and levels.
pub(super) type CountSubtree<T> = fn(&mut T, &[u8], u8) -> Result<(), BadSkip>;

/// Kernel that passes the cells of a dense block in a box to a `T`.
pub(super) type CountDense<T> = fn(&mut T, &DenseBlock<'_>, ([usize; 3], [usize; 3]));

/// Statistics in progress.
pub(super) trait Count {
    /// Counts cells of a value.
    fn block(&mut self, value: Value, cells: u64);
    /// Counts all cells of a zone. Returns `false` if its statistics do not suffice.
    ///
    /// # Errors
    /// If the zone is corrupt.
    fn zone(&mut self, zone: &dyn Zone) -> Result<bool>;
    /// Returns whether zones are read from their segments and not only from the segment index.
    fn reads_zones(&self) -> bool {
        false
    }
    /// Counts all cells of a subtree of `levels` levels, given its records.
    ///
    /// # Errors
    /// If skips or states contradict each other.
    fn subtree(&mut self, records: &[u8], levels: u8) -> Result<(), BadSkip>;
    /// Counts the cells of a dense block in a box, given as the first cell and the size along each
    /// axis.
    fn dense(&mut self, block: &DenseBlock<'_>, part: ([usize; 3], [usize; 3]));
    /// Returns the statistics of everything that was counted.
    fn finish(self: Box<Self>) -> ZoneStats;
}

/// Creates an empty counter for trees of `form` that does not count classes.
pub(super) fn counter_of(form: TreeType) -> Box<dyn Count> {
    if form.value.is_masked() {
        let subtree = with_record_type!(RecordLayout::new(form), R => count_masked_subtree::<R>);
        return Box::new(MaskedCounter { form, tally: ZoneStats::void(form.value), subtree });
    }
    with_form_type!(form, V, R => Box::new(Counter::<V> {
        cells: 0,
        min: V::default(),
        max: V::default(),
        sums: Default::default(),
        squares: Default::default(),
        subtree: count_subtree::<V, R>,
        dense: count_dense::<V, R>,
    }))
}

/// A [`ZoneStats`] of values of a known type.
struct Counter<V: Native> {
    cells: u64,
    min: V,
    max: V,
    sums: V::TotalSums,
    squares: V::TotalSquares,
    /// Depends on the fan-out; nothing else here does.
    subtree: CountSubtree<Counter<V>>,
    dense: CountDense<Counter<V>>,
}

impl<V: Native> Counter<V> {
    /// Adds cells to the count, and extends the extremes.
    #[inline]
    fn widen(&mut self, min: V, max: V, cells: u64) {
        if self.cells == 0 {
            (self.min, self.max) = (min, max);
        }
        self.cells += cells;
        self.min = self.min.min(min);
        self.max = self.max.max(max);
    }

    /// Counts cells of a value.
    ///
    /// Inexact sums depend on the order. The order is therefore part of the definition: leaf by
    /// leaf, each multiplied by its cell count first.
    #[inline]
    fn add(&mut self, value: V, cells: u64) {
        self.widen(value, value, cells);
        self.sums = V::add_sums(self.sums, value.total_sums(cells));
        self.squares = V::add_squares(self.squares, value.total_squares(cells));
    }

    /// Counts cells whose sums are exact in any order, in the narrowest sums that suffice, so that
    /// the loop vectorizes.
    #[inline(never)]
    fn add_row(&mut self, row: &[V::Wire]) {
        // Invariant: a row of a dense block has at most 256 cells, and narrow sums hold 2^15.
        let Some(first) = row.first().map(|wire| V::from_wire(*wire)) else { return };
        let (mut min, mut max) = (first, first);
        let (mut sums, mut squares) = (V::NarrowSums::default(), V::NarrowSquares::default());
        for wire in row {
            let value = V::from_wire(*wire);
            (min, max) = (min.min(value), max.max(value));
            sums = V::add_narrow_sums(sums, value.narrow_sums());
            squares = V::add_narrow_squares(squares, value.narrow_squares());
        }
        self.widen(min, max, row.len() as u64);
        self.sums = V::add_sums(self.sums, V::widen(V::widen_narrow(sums)));
        self.squares = V::add_squares(self.squares, V::widen_squares(V::widen_narrow_squares(squares)));
    }
}

impl<V: Native> Count for Counter<V> {
    fn block(&mut self, value: Value, cells: u64) {
        self.add(native::<V>(value), cells);
    }

    fn zone(&mut self, zone: &dyn Zone) -> Result<bool> {
        let zone = zone.tally()?;
        if zone.cells > 0 {
            self.widen(native::<V>(zone.min), native::<V>(zone.max), zone.cells);
        }
        self.sums = V::add_sums(self.sums, V::typed_sums(&zone.sum));
        self.squares = V::add_squares(self.squares, V::typed_squares(&zone.squares));
        Ok(true)
    }

    fn subtree(&mut self, records: &[u8], levels: u8) -> Result<(), BadSkip> {
        (self.subtree)(self, records, levels)
    }

    fn dense(&mut self, block: &DenseBlock<'_>, part: ([usize; 3], [usize; 3])) {
        (self.dense)(self, block, part);
    }

    fn finish(self: Box<Self>) -> ZoneStats {
        ZoneStats {
            value_type: V::TYPE,
            cells: self.cells,
            present: [self.cells; 4],
            min: erase(self.min),
            max: erase(self.max),
            sum: V::erase(self.sums),
            squares: V::erase_squares(self.squares),
            classes: Vec::new(),
        }
    }
}

fn count_dense<V: Native, R: Record>(
    counter: &mut Counter<V>,
    block: &DenseBlock<'_>,
    part: ([usize; 3], [usize; 3]),
) {
    if const { !V::TYPE.sample.is_float() } && block.mask().is_none() {
        // (Both types have the same size by construction.)
        block.rows_in::<R>(part, &mut |row| {
            counter.add_row(<[V::Wire]>::ref_from_bytes(row.as_bytes()).unwrap_or(&[]));
        });
        return;
    }
    block.each_leaf_in::<R>(part, &mut |bytes| counter.add(value_of::<V, R>(bytes), 1));
}

/// Converts a value of a record to its native type.
#[inline]
fn value_of<V: Native, R: Record>(bytes: R::Bytes) -> V {
    // (Both types have the same size by construction.)
    V::from_wire(V::Wire::read_from_bytes(bytes.as_bytes()).expect("as many bytes as the value has"))
}

fn count_subtree<V: Native, R: Record>(
    counter: &mut Counter<V>,
    records: &[u8],
    levels: u8,
) -> Result<(), BadSkip> {
    each_leaf_or_block(R::of(records), levels, |part| match part {
        LeafOrBlock::Leaf(bytes, cells) => counter.add(value_of::<V, R>(bytes), cells),
        LeafOrBlock::Block(block) => count_dense::<V, R>(counter, block, block.whole()),
    })
}

/// A [`ZoneStats`] of values in which samples can be missing.
struct MaskedCounter {
    form: TreeType,
    tally: ZoneStats,
    subtree: CountSubtree<MaskedCounter>,
}

impl Count for MaskedCounter {
    fn block(&mut self, value: Value, cells: u64) {
        self.tally =
            ZoneStats::merge(&[&self.tally, &ZoneStats::leaf(self.tally.value_type, value, cells, false)]);
    }

    fn zone(&mut self, zone: &dyn Zone) -> Result<bool> {
        self.tally = ZoneStats::merge(&[&self.tally, &ZoneStats { classes: Vec::new(), ..zone.tally()? }]);
        Ok(true)
    }

    fn subtree(&mut self, records: &[u8], levels: u8) -> Result<(), BadSkip> {
        (self.subtree)(self, records, levels)
    }

    fn dense(&mut self, block: &DenseBlock<'_>, part: ([usize; 3], [usize; 3])) {
        with_record_type!(RecordLayout::new(self.form), R => {
            block.each_leaf_in::<R>(part, &mut |bytes| self.block(Value::from_bytes(bytes.as_bytes()), 1));
        });
    }

    fn finish(self: Box<Self>) -> ZoneStats {
        self.tally
    }
}

fn count_masked_subtree<R: Record>(
    counter: &mut MaskedCounter,
    records: &[u8],
    levels: u8,
) -> Result<(), BadSkip> {
    each_leaf(R::of(records), levels, |bytes, cells| {
        counter.block(Value::from_bytes(bytes.as_bytes()), cells)
    })
}

/// Returns the function that reads a value's first sample exactly.
pub(super) fn exact_number_of(value_type: ValueType) -> fn(Value) -> Number {
    with_sample_type!(value_type.sample, S => first_number::<S>)
}

fn first_number<S: Sample>(value: Value) -> Number {
    S::read(&value.to_bytes()).to_number()
}

/// Returns the function that reads a value's first sample as `f64`.
pub(super) fn number_of(value_type: ValueType) -> fn(Value) -> f64 {
    with_sample_type!(value_type.sample, S => first_sample::<S>)
}

fn first_sample<S: Sample>(value: Value) -> f64 {
    S::read(&value.to_bytes()).to_f64()
}

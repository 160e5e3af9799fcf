//! Counts the cells of each value.

use zerocopy::IntoBytes;

use super::count::{Count, CountDense, CountSubtree};
use super::walk::Zone;
use crate::store::records::dense::{DenseBlock, DenseRows};
use crate::store::records::subtree::{BadSkip, each_leaf};
use crate::store::records::{Record, RecordLayout, with_record_type};
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::sort;
use spinney_base::value::{Value, ValueType, ZoneStats};

/// Returns the tally of the cells of each value, given by ascending value.
pub(super) fn tally_of_classes(value_type: ValueType, classes: Vec<(Value, u64)>) -> ZoneStats {
    let mut tally = ZoneStats::void(value_type);
    for (value, cells) in &classes {
        tally = ZoneStats::merge(&[&tally, &ZoneStats::leaf(value_type, *value, *cells, false)]);
    }
    ZoneStats { classes, ..tally }
}

/// Counts cells of each value. Caches the last class because neighbours are often equal.
pub(super) struct Classes {
    value_type: ValueType,
    /// Classes found so far, by ascending value.
    counts: Vec<Class>,
    /// Cells of values that are not in `counts` yet, in any order. They are merged in bulk, so that
    /// the time is not quadratic in the number of classes.
    pending: Vec<Class>,
    /// Index of the class that was counted last.
    last: usize,
    /// Cells of each one-byte value, still to be added.
    bytes: Box<[u64; 256]>,
    subtree: CountSubtree<Classes>,
    dense: CountDense<Classes>,
}

/// Maximum number of pending entries, unless there are more classes.
const MAX_PENDING: usize = 1 << 12;

struct Class {
    /// See [`ValueType::order_key`].
    key: u128,
    value: Value,
    cells: u64,
}

impl Classes {
    /// Creates an empty count for trees of `form`.
    pub(super) fn new(form: TreeType) -> Classes {
        Classes {
            value_type: form.value,
            counts: Vec::new(),
            pending: Vec::new(),
            last: 0,
            bytes: Box::new([0; 256]),
            subtree: with_record_type!(RecordLayout::new(form), R => count_subtree::<R>),
            dense: with_record_type!(RecordLayout::new(form), R => count_dense::<R>),
        }
    }

    /// Counts cells of a one-byte value, without a search.
    #[inline]
    fn add_byte(&mut self, byte: u8, cells: u64) {
        self.bytes[usize::from(byte)] += cells;
    }

    /// Counts cells of a value of several bytes.
    #[inline]
    fn add(&mut self, value: Value, cells: u64) {
        match self.counts.get_mut(self.last) {
            Some(last) if last.value == value => last.cells += cells,
            _ => self.search(value, cells),
        }
    }

    /// Counts cells of another value than the last.
    #[inline(never)]
    fn search(&mut self, value: Value, cells: u64) {
        let key = self.value_type.order_key(value);
        if let Ok(index) = self.counts.binary_search_by_key(&key, |class| class.key) {
            self.counts[index].cells += cells;
            self.last = index;
            return;
        }
        match self.pending.last_mut().filter(|last| last.key == key) {
            Some(last) => last.cells += cells,
            None => self.pending.push(Class { key, value, cells }),
        }
        if self.pending.len() > MAX_PENDING.max(self.counts.len()) {
            self.sort_in();
        }
    }

    /// Merges the pending entries.
    fn sort_in(&mut self) {
        self.counts.append(&mut self.pending);
        // (The first of the two runs is sorted already, which a stable sort exploits.)
        sort::by_wide_key(&mut self.counts, |class| class.key);
        self.counts.dedup_by(|next, class| {
            let same = next.key == class.key;
            if same {
                class.cells += next.cells;
            }
            same
        });
    }
}

impl Count for Classes {
    fn reads_zones(&self) -> bool {
        true
    }

    fn block(&mut self, value: Value, cells: u64) {
        if self.value_type.size() == 1 {
            self.add_byte(value.to_bytes()[0], cells);
        } else {
            self.add(value, cells);
        }
    }

    fn zone(&mut self, zone: &dyn Zone) -> Result<bool> {
        let classes = zone.classes()?;
        if classes.is_empty() {
            return Ok(zone.tally()?.cells == 0);
        }
        classes.into_iter().for_each(|(value, cells)| self.block(value, cells));
        Ok(true)
    }

    fn subtree(&mut self, records: &[u8], levels: u8) -> Result<(), BadSkip> {
        (self.subtree)(self, records, levels)
    }

    fn dense(&mut self, block: &DenseBlock<'_>, part: ([usize; 3], [usize; 3])) {
        (self.dense)(self, block, part);
    }

    fn finish(mut self: Box<Self>) -> ZoneStats {
        for byte in 0..=u8::MAX {
            let cells = self.bytes[usize::from(byte)];
            if cells > 0 {
                self.search(Value::from([byte]), cells);
            }
        }
        self.sort_in();
        let classes = self.counts.iter().map(|class| (class.value, class.cells)).collect();
        tally_of_classes(self.value_type, classes)
    }
}

fn count_subtree<R: Record>(classes: &mut Classes, records: &[u8], levels: u8) -> Result<(), BadSkip> {
    each_leaf(R::of(records), levels, |bytes, cells| count_bytes(classes, bytes.as_bytes(), cells))
}

fn count_dense<R: Record>(classes: &mut Classes, block: &DenseBlock<'_>, part: ([usize; 3], [usize; 3])) {
    block.each_leaf_in::<R>(part, &mut |bytes| count_bytes(classes, bytes.as_bytes(), 1));
}

#[inline]
fn count_bytes(classes: &mut Classes, bytes: &[u8], cells: u64) {
    match bytes {
        [byte] => classes.add_byte(*byte, cells),
        bytes => classes.add(Value::from_bytes(bytes), cells),
    }
}

//! Cell counts per sample in a zone, for any sample type and in bounded memory, and the measures
//! derived from them.

use zerocopy::IntoBytes;

use super::AddDense;
use super::cells::{in_cells, in_shares};
use super::request::{ZonalRequest, ZoneValues};
use crate::store::records::dense::{DenseBlock, DenseRows};
use crate::store::records::subtree::{BadSkip, each_leaf};
use crate::store::records::{Record, RecordLayout, with_record_type};
use spinney_base::io::Sorter;
use spinney_base::sort;
use spinney_base::value::{Number, Sample, Value, ValueType, ZoneStats, with_sample_type};
use spinney_base::{Result, TreeType};
use spinney_overlay::FULL_SHARE;

/// Cell counts per sample for each channel of a zone.
pub(super) struct Values {
    value_type: ValueType,
    channels: Vec<Channel>,
    /// Conversions from a sample to its key and back: see [`Sample::order_key`].
    key: fn(&[u8]) -> u64,
    number: fn(u64) -> Number,
    subtree: fn(&mut Values, &[u8], u8) -> Result<(), BadSkip>,
    dense: AddDense<Values>,
    /// First error of a temporary file.
    failed: Result<()>,
}

/// Cell counts per sample of a channel.
struct Channel {
    /// Counts in any order, with repeated keys. A sorted prefix without repetitions comes from the
    /// last merge.
    entries: Vec<Entry>,
    /// Number of entries at which equal keys are merged.
    limit: usize,
    /// Maximum number of entries in memory.
    most: usize,
    /// Counts by key from `first` on, used once there are many samples of at most two bytes.
    table: Vec<u128>,
    /// The key of the table's first count.
    first: u64,
    /// Bits of a sample.
    bits: usize,
    /// Entries that exceed the memory limit.
    sorter: Option<Sorter>,
}

/// A key, and its cells in shares.
type Entry = (u64, u128);

/// Minimum number of entries to collect before equal keys are merged.
const MIN_ENTRIES: usize = 1 << 12;

impl Values {
    /// Creates empty counts for trees of `form` that may use `memory` bytes.
    pub(super) fn new(form: TreeType, memory: u64) -> Values {
        let value_type = form.value;
        let bits = 8 * value_type.sample.size();
        let channels = u64::from(value_type.channels);
        let most = (memory / channels / ENTRY_BYTES).clamp(MIN_ENTRIES as u64, u64::from(u32::MAX)) as usize;
        let channel = |_| Channel {
            entries: Vec::new(),
            limit: MIN_ENTRIES,
            most,
            table: if bits == 8 { vec![0; 1 << bits] } else { Vec::new() },
            first: 0,
            bits,
            sorter: None,
        };
        Values {
            value_type,
            channels: (0..channels).map(channel).collect(),
            key: with_sample_type!(value_type.sample, S => key_of::<S>),
            number: with_sample_type!(value_type.sample, S => number_of::<S>),
            subtree: with_record_type!(RecordLayout::new(form), R => add_subtree::<R>),
            dense: with_record_type!(RecordLayout::new(form), R => add_dense::<R>),
            failed: Ok(()),
        }
    }

    /// Adds cells of a value with a total of `cells` shares.
    pub(super) fn block(&mut self, value: Value, cells: u128) {
        self.add(&value.to_bytes(), cells);
    }

    /// Adds all cells of a zone. Returns `false` if its tally does not determine their samples.
    pub(super) fn zone(&mut self, tally: &ZoneStats) -> bool {
        let is_one = tally.min == tally.max && !self.value_type.is_masked();
        if is_one && tally.cells > 0 {
            self.block(tally.min, in_shares((tally.cells, 0)));
        }
        is_one || tally.cells == 0
    }

    /// Adds all cells of a subtree of `levels` levels, given its records.
    ///
    /// # Errors
    /// If skips or states contradict each other.
    pub(super) fn subtree(&mut self, records: &[u8], levels: u8) -> Result<(), BadSkip> {
        (self.subtree)(self, records, levels)
    }

    /// Adds the cells of a dense block in a box, each with the same share.
    pub(super) fn dense(&mut self, block: &DenseBlock<'_>, part: ([usize; 3], [usize; 3]), share: u64) {
        (self.dense)(self, block, part, share);
    }

    /// Adds cells of a value, given its bytes.
    #[inline]
    fn add(&mut self, bytes: &[u8], cells: u128) {
        let size = self.value_type.sample.size();
        if !self.value_type.is_masked() {
            for (channel, sample) in self.channels.iter_mut().zip(bytes.chunks_exact(size)) {
                channel.add((self.key)(sample), cells, &mut self.failed);
            }
            return;
        }
        let present = self.value_type.present(Value::from_bytes(&bytes[..self.value_type.size()]));
        let samples = self.channels.iter_mut().zip(bytes.chunks_exact(size));
        for ((channel, sample), _) in samples.zip(present).filter(|(_, is_there)| *is_there) {
            channel.add((self.key)(sample), cells, &mut self.failed);
        }
    }

    /// Returns the measures of each channel. `cells` has the cell count of each channel.
    ///
    /// # Errors
    /// If temporary files cannot be used.
    pub(super) fn finish(self, cells: &[f64], request: &ZonalRequest) -> Result<Vec<Option<ZoneValues>>> {
        self.failed?;
        let number = self.number;
        let channels = self.channels.into_iter().zip(cells);
        channels.map(|(channel, cells)| channel.finish(number, *cells, request)).collect()
    }
}

/// Bytes per entry in memory, including sorting and reallocation.
const ENTRY_BYTES: u64 = 128;

fn key_of<S: Sample>(bytes: &[u8]) -> u64 {
    S::read(bytes).order_key()
}

fn number_of<S: Sample>(key: u64) -> Number {
    S::from_order_key(key).to_number()
}

fn add_subtree<R: Record>(values: &mut Values, records: &[u8], levels: u8) -> Result<(), BadSkip> {
    each_leaf(R::of(records), levels, |bytes, cells| values.add(bytes.as_bytes(), in_shares((cells, 0))))
}

fn add_dense<R: Record>(
    values: &mut Values,
    block: &DenseBlock<'_>,
    part: ([usize; 3], [usize; 3]),
    share: u64,
) {
    block.each_leaf_in::<R>(part, &mut |bytes| values.add(bytes.as_bytes(), share.into()));
}

impl Channel {
    #[inline]
    fn add(&mut self, key: u64, cells: u128, failed: &mut Result<()>) {
        if let Some(known) = self.table.get_mut(key.wrapping_sub(self.first) as usize) {
            *known += cells;
            return;
        }
        match self.entries.last_mut() {
            // (Neighbours are often equal.)
            Some(last) if last.0 == key => last.1 += cells,
            _ => self.push(key, cells, failed),
        }
    }

    #[inline(never)]
    fn push(&mut self, key: u64, cells: u128, failed: &mut Result<()>) {
        if self.entries.len() >= self.limit
            && let Err(error) = self.free_memory()
        {
            // (The counts are incomplete from here on; `finish` returns the error.)
            self.entries.clear();
            *failed = Err(error);
        }
        match self.table.get_mut(key.wrapping_sub(self.first) as usize) {
            Some(known) => *known += cells,
            None => self.entries.push((key, cells)),
        }
    }

    /// Merges equal samples, in a table if the sample type has few values. If more than half of the
    /// memory limit is still used, the entries move to temporary files.
    fn free_memory(&mut self) -> Result<()> {
        if self.bits <= 16 {
            self.move_to_table();
            return Ok(());
        }
        self.merge_entries();
        if self.entries.len() > self.most / 2 {
            let memory = self.most as u64 / 4 * ENTRY_BYTES;
            let sorter = self.sorter.get_or_insert_with(|| Sorter::new(&std::env::temp_dir(), memory));
            for (key, cells) in self.entries.drain(..) {
                sorter.push(key, &item_of(key, cells))?;
            }
        }
        // (Leave space for as many new entries as there are, so that the time for sorting stays
        // small.)
        self.limit = (2 * self.entries.len()).clamp(MIN_ENTRIES, self.most);
        Ok(())
    }

    /// Moves the entries to the table, which gets a range of keys that has theirs. The table of a
    /// zone is as short as the range of its samples, since most zones have few of 65,536 values.
    fn move_to_table(&mut self) {
        let keys = || self.entries.iter().map(|(key, _)| *key);
        let (Some(low), Some(high)) = (keys().min(), keys().max()) else { return };
        let (before, end) = (self.first, self.first + self.table.len() as u64);
        let (low, high) =
            if before == end { (low, high + 1) } else { (low.min(before), (high + 1).max(end)) };
        // (With a margin, so that the table does not grow with each new sample.)
        let margin = (high - low) / 2;
        let (first, end) = (low.saturating_sub(margin), (high + margin).min(1 << self.bits));
        let mut table = vec![0; (end - first) as usize];
        let at = (before.max(first) - first) as usize;
        table[at..at + self.table.len()].copy_from_slice(&self.table);
        for (key, cells) in self.entries.drain(..) {
            table[(key - first) as usize] += cells;
        }
        (self.table, self.first) = (table, first);
    }

    fn merge_entries(&mut self) {
        sort::by_key(&mut self.entries, |entry| entry.0);
        self.entries.dedup_by(|next, entry| {
            let is_same = next.0 == entry.0;
            if is_same {
                entry.1 += next.1;
            }
            is_same
        });
    }

    /// Returns the measures of samples with `all` cells in total.
    fn finish(
        mut self,
        number: fn(u64) -> Number,
        all: f64,
        request: &ZonalRequest,
    ) -> Result<Option<ZoneValues>> {
        let mut measures = OrderStatistics::new(all, request);
        if !self.table.is_empty() {
            self.move_to_table();
            let counted = (self.first..).zip(&self.table).filter(|(_, cells)| **cells > 0);
            counted.for_each(|(key, cells)| measures.add(number(key), *cells));
            return Ok(measures.finish());
        }
        self.merge_entries();
        let Some(mut sorter) = self.sorter else {
            self.entries.iter().for_each(|(key, cells)| measures.add(number(*key), *cells));
            return Ok(measures.finish());
        };
        for (key, cells) in std::mem::take(&mut self.entries) {
            sorter.push(key, &item_of(key, cells))?;
        }
        sorter.finish(&mut |item| {
            let (key, cells) = entry_of(item);
            measures.add(number(key), cells);
            Ok(())
        })?;
        Ok(measures.finish())
    }
}

fn item_of(key: u64, cells: u128) -> Vec<u8> {
    [&key.to_le_bytes()[..], &cells.to_le_bytes()].concat()
}

fn entry_of(item: &[u8]) -> Entry {
    let key = u64::from_le_bytes(std::array::from_fn(|byte| item[byte]));
    (key, u128::from_le_bytes(std::array::from_fn(|byte| item[8 + byte])))
}

/// Returns the measures from the cells of each class, in ascending order of classes.
pub(super) fn of_classes(classes: &[(Number, f64)], request: &ZonalRequest) -> Option<ZoneValues> {
    let mut measures = OrderStatistics::new(classes.iter().map(|(_, cells)| *cells).sum(), request);
    for (class, cells) in classes {
        measures.add(*class, (*cells * FULL_SHARE as f64) as u128);
    }
    measures.finish()
}

/// Computes measures from samples in ascending order.
struct OrderStatistics {
    values: ZoneValues,
    /// Shares of the majority and of the minority.
    most: u128,
    fewest: u128,
    /// The last sample and its shares. The next sample may be equal (-0.0 and 0, or entries split
    /// over temporary files).
    last: Option<(Number, u128)>,
    /// Shares of all samples before the last.
    before: u128,
    /// Windows of all quantiles including the median, by their start.
    windows: Vec<Window>,
    /// Number of windows that end before the last sample.
    done: usize,
}

/// Interval of the sorted samples, in cells, whose mean is a quantile.
struct Window {
    /// Index of the quantile; `None` for the median.
    number: Option<usize>,
    /// Start and end of the interval in cells.
    from: f64,
    to: f64,
    /// First sample in it, weighted sum of the others' differences from the first, and total
    /// weight.
    first: f64,
    more: f64,
    cells: f64,
}

impl OrderStatistics {
    /// Creates an accumulator for `all` cells in total.
    fn new(all: f64, request: &ZonalRequest) -> OrderStatistics {
        let window = |number: Option<usize>, quantile: f64| {
            let from = (quantile * (all - 1.0)).max(0.0);
            let to = (from + 1.0).min(all.max(f64::MIN_POSITIVE));
            Window { number, from, to, first: f64::NAN, more: 0.0, cells: 0.0 }
        };
        let requested =
            (0..).zip(&request.quantiles).map(|(number, quantile)| window(Some(number), *quantile));
        let mut windows: Vec<Window> = requested.chain([window(None, 0.5)]).collect();
        sort::by(&mut windows, &mut |a, b| a.from.total_cmp(&b.from));
        let quantiles = vec![f64::NAN; request.quantiles.len()];
        let values = ZoneValues { quantiles, ..ZoneValues::default() };
        OrderStatistics { values, most: 0, fewest: u128::MAX, last: None, before: 0, windows, done: 0 }
    }

    /// Adds cells of a sample that is not less than those before.
    fn add(&mut self, sample: Number, cells: u128) {
        match &mut self.last {
            Some((last, more)) if *last == sample.with_plain_zero() => *more += cells,
            _ => {
                self.end();
                self.last = Some((sample.with_plain_zero(), cells));
            }
        }
    }

    /// Counts the last sample, whose shares are complete.
    fn end(&mut self) {
        let Some((sample, cells)) = self.last.take() else { return };
        self.values.variety += 1;
        if cells > self.most {
            (self.most, self.values.majority) = (cells, sample);
        }
        if cells < self.fewest {
            (self.fewest, self.values.minority) = (cells, sample);
        }
        let after = self.before + cells;
        let (from, to, sample) = (in_cells(self.before), in_cells(after), sample.to_f64());
        while self.windows.get(self.done).is_some_and(|window| window.to <= from) {
            self.done += 1;
        }
        // (All windows have the same length, so they end in the order in which they start.)
        let windows = self.windows[self.done..].iter_mut().take_while(|window| window.from < to);
        for window in windows {
            let inside = window.to.min(to) - window.from.max(from);
            if window.cells == 0.0 {
                window.first = sample;
            } else if sample != window.first {
                window.more += (sample - window.first) * inside;
            }
            window.cells += inside;
        }
        self.before = after;
    }

    /// Returns the measures, or `None` if there were no samples.
    fn finish(mut self) -> Option<ZoneValues> {
        self.end();
        for window in &self.windows {
            let quantile = window.first + window.more / window.cells;
            match window.number {
                Some(number) => self.values.quantiles[number] = quantile,
                None => self.values.median = quantile,
            }
        }
        (self.values.variety > 0).then_some(self.values)
    }
}

//! The Autumnal record: a node, some levels of what is below it, and pointers to the records of nodes further down.
//!
//! Nodes at certain heights have records ([`Heights`]), at every second level. A record has the node's representative,
//! pointers to the records of the next nodes below that have one, the levels below as a run, as it would stand in a segment
//! of a Goblin file, and a zone if it is large. Runs may reach further down than the nodes that pointers lead to, so that any
//! level can be drawn from records that have much of it. What is small enough is one run alone.

use std::ops::RangeInclusive;

use crate::store::records::{Descend, RecordLayout, descend_in};
use spinney_base::TreeType;
use spinney_base::space::Dimension;
use spinney_base::value::Value;
use spinney_container::Shape;

/// Levels between nodes with records.
const STRIDE: u8 = 2;

/// The heights (levels above the cells) of the nodes that have records of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Heights {
    /// Levels of a run; what is no higher is one run.
    pub(super) run: u8,
    /// That of the smallest nodes with zones, but for the root.
    zone: u8,
    /// That of the root, which has a record whatever its height.
    root: u8,
}

impl Heights {
    /// Those of a tree with so many levels below its root, in runs of so many levels.
    pub(super) fn new(dimension: Dimension, run: u8, depth: u8) -> Heights {
        let above = least_zone(dimension).saturating_sub(run).next_multiple_of(STRIDE);
        Heights { run, zone: run + above, root: depth }
    }

    /// The height of the node whose record has a node of some height.
    #[inline]
    pub(super) fn record_of(&self, height: u8) -> u8 {
        let above = height.saturating_sub(self.run).next_multiple_of(STRIDE);
        (self.run + above).min(self.root)
    }

    /// The height of the nodes that pointers of a record lead to, whose own node has a height; `None` if it is one run alone.
    #[inline]
    pub(super) fn below(&self, height: u8) -> Option<u8> {
        let above = height.checked_sub(self.run + 1)?;
        Some(self.run + above / STRIDE * STRIDE)
    }

    /// Levels of the run of a node of some height that has a record.
    #[inline]
    pub(super) fn run_of(&self, height: u8) -> u8 {
        self.run.min(height)
    }

    /// Whether a node of some height that has a record has a zone.
    #[inline]
    pub(super) fn has_zone(&self, height: u8) -> bool {
        height > self.run && height >= self.zone.min(self.root)
    }

    /// The shape that makes blocks as large as the smallest nodes with zones, and leaves all their records together.
    pub(super) fn shape(&self) -> Shape {
        Shape { depth: self.root, reach: self.zone, stride: 1, heavy_threshold: u32::MAX }
    }
}

/// Levels of runs that files may have. Of the most, 32 x 32 values, or 8 x 8 x 8, are written anew where one of them changes,
/// and any level is drawn from records of which much is needed. Of the fewest, more subtrees are equal: files that
/// store these once have them.
pub(super) const fn run_levels(dimension: Dimension) -> RangeInclusive<u8> {
    match dimension {
        Dimension::Quad => STRIDE..=5,
        Dimension::Oct => STRIDE..=3,
    }
}

/// The height from which on nodes with records have zones: 128 x 128 cells, or 32 x 32 x 32.
const fn least_zone(dimension: Dimension) -> u8 {
    *run_levels(dimension).end() + STRIDE
}

/// Bytes of the longest pointer.
const MAX_POINTER: usize = 8;

/// Layout of the records of a file.
#[derive(Clone)]
pub(super) struct PointeredLayout {
    /// Quadtree or octree, and the type of the values.
    pub(super) form: TreeType,
    pub(super) heights: Heights,
    /// Layout of the records of runs.
    pub(super) run: RecordLayout,
    /// The way down in a run.
    pub(super) descend: Descend,
}

/// The records that a record leads to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Pointers {
    /// Bit `i`: whether there is one for node `i`, in Z order, of those that pointers lead to.
    pub(super) bitmap: u64,
    /// The addresses of these.
    pub(super) targets: Vec<u64>,
}

/// The parts of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RecordParts {
    /// See [`Pointers`].
    bitmap: u64,
    /// Bytes of a pointer.
    pointer: u8,
    /// Where pointers and run start, and where the run ends.
    pointers_at: usize,
    run_at: usize,
    pub(super) end: usize,
}

/// Reason why bytes are no record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BadRecord {
    /// There must be so many of them, to begin with.
    Short(usize),
    /// They say something impossible.
    Wrong,
}

impl PointeredLayout {
    /// The layout for trees of a form and a depth, in runs of so many levels.
    pub(super) fn new(form: TreeType, run_levels: u8, depth: u8) -> PointeredLayout {
        let (heights, run) = (Heights::new(form.dimension, run_levels, depth), RecordLayout::new(form));
        PointeredLayout { form, heights, run, descend: descend_in(run) }
    }

    /// Bytes of a bit for each of the nodes so many levels below one.
    #[inline]
    fn bitmap_size(&self, levels: u8) -> usize {
        self.form.dimension.cells(levels).div_ceil(8) as usize
    }

    /// Bytes of a bit for each node that a record of some height may have a pointer for; `None` if it has no pointers.
    pub(super) fn bitmap_bytes(&self, height: u8) -> Option<usize> {
        self.heights.below(height).map(|below| self.bitmap_size(height - below))
    }

    /// Bytes of a value.
    #[inline]
    pub(super) fn width(&self) -> usize {
        self.run.width
    }

    /// The representative at a record's start; `None` if it is cut short.
    #[inline]
    pub(super) fn representative(&self, record: &[u8]) -> Option<Value> {
        Value::read(record, self.width())
    }

    /// Finds the parts of the record of a node of some height.
    #[inline]
    pub(super) fn parts(&self, record: &[u8], height: u8) -> Result<RecordParts, BadRecord> {
        let width = self.width();
        let mut parts = RecordParts { bitmap: 0, pointer: 0, pointers_at: width, run_at: width, end: width };
        if let Some(below) = self.heights.below(height) {
            let size = self.bitmap_size(height - below);
            parts.pointers_at = width + 1 + size;
            let head = record.get(width..parts.pointers_at).ok_or(BadRecord::Short(parts.pointers_at))?;
            parts.pointer = head[0];
            let mut bitmap = [0; size_of::<u64>()];
            bitmap[..size].copy_from_slice(&head[1..]);
            parts.bitmap = u64::from_le_bytes(bitmap);
            let nodes = self.form.dimension.cells(height - below);
            let is_good = (1..=MAX_POINTER).contains(&usize::from(parts.pointer))
                && parts.bitmap & !(u64::MAX >> (64 - nodes)) == 0;
            if !is_good {
                return Err(BadRecord::Wrong);
            }
            parts.run_at =
                parts.pointers_at + parts.bitmap.count_ones() as usize * usize::from(parts.pointer);
        }
        let first = parts.run_at + self.run.size;
        let head = record.get(parts.run_at..first).ok_or(BadRecord::Short(first))?;
        let skip = self.run.head(head, 0).ok_or(BadRecord::Wrong)?.skip;
        // A tree without a uniform node has 1 + c + c^2 ... records for c children.
        let levels = self.heights.run_of(height);
        let most = (self.form.dimension.cells(levels) - 1) / (self.form.children() as u64 - 1);
        if !(1..=most).contains(&u64::from(skip)) {
            return Err(BadRecord::Wrong);
        }
        parts.end = parts.run_at + skip as usize * self.run.size;
        if parts.end > record.len() { Err(BadRecord::Short(parts.end)) } else { Ok(parts) }
    }

    /// Adds the record of a node of some height that is to stand at `address` to a buffer, without a zone. Pointers lead to what
    /// is before it; a record that is one run alone has none.
    pub(super) fn encode(
        &self,
        (address, height): (u64, u8),
        representative: Value,
        Pointers { bitmap, targets }: &Pointers,
        run: &[u8],
        buffer: &mut Vec<u8>,
    ) {
        buffer.extend_from_slice(&representative.to_bytes()[..self.width()]);
        if let Some(below) = self.heights.below(height) {
            // As many bytes as the longest distance back needs.
            let longest = targets.iter().map(|target| address - target).max().unwrap_or(1);
            let bytes = (8 - longest.leading_zeros() as usize / 8).max(1);
            buffer.push(bytes as u8);
            buffer.extend_from_slice(&bitmap.to_le_bytes()[..self.bitmap_size(height - below)]);
            for target in targets {
                buffer.extend_from_slice(&(address - target).to_le_bytes()[..bytes]);
            }
        }
        buffer.extend_from_slice(run);
    }
}

impl RecordParts {
    /// The run among a record's bytes.
    #[inline]
    pub(super) fn run<'r>(&self, record: &'r [u8]) -> &'r [u8] {
        &record[self.run_at..self.end]
    }

    /// Where the run starts in the record.
    pub(super) fn run_start(&self) -> usize {
        self.run_at
    }

    /// The address that the pointer of a node leads to, in a record at `address`. The first option is `None` if it does not
    /// lead back, the second if there is none.
    #[inline]
    pub(super) fn pointer(&self, record: &[u8], address: u64, node: usize) -> Option<Option<u64>> {
        if self.bitmap >> node & 1 == 0 {
            return Some(None);
        }
        let before = (self.bitmap & ((1 << node) - 1)).count_ones() as usize;
        let size = usize::from(self.pointer);
        let mut distance = [0; MAX_POINTER];
        distance[..size].copy_from_slice(&record[self.pointers_at + before * size..][..size]);
        // Records come after those that they point to: whoever follows pointers gets ever nearer to the file's start.
        let distance = u64::from_le_bytes(distance);
        let target = address.checked_sub(distance).filter(|_| distance > 0)?;
        Some(Some(target))
    }

    /// All pointers of a record at `address`; `None` if one does not lead back.
    pub(super) fn pointers(&self, record: &[u8], address: u64) -> Option<Pointers> {
        let nodes = (0..64).filter(|node| self.bitmap >> node & 1 != 0);
        let targets: Option<Vec<u64>> =
            nodes.map(|node| self.pointer(record, address, node).flatten()).collect();
        targets.map(|targets| Pointers { bitmap: self.bitmap, targets })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::records::RecordHead;
    use spinney_base::value::{SampleType, ValueType};

    #[test]
    fn heights_of_records() {
        let heights = Heights::new(Dimension::Quad, 5, 16);
        let records = [16, 15, 14, 12, 9, 8, 6, 5, 1].map(|height| heights.record_of(height));
        assert_eq!(records, [16, 15, 15, 13, 9, 9, 7, 5, 5]);
        let below = [16, 15, 13, 7, 5].map(|height| heights.below(height));
        assert_eq!(below, [Some(15), Some(13), Some(11), Some(5), None]);
        let small = Heights::new(Dimension::Oct, 3, 4);
        assert_eq!([4, 3, 1].map(|height| small.record_of(height)), [4, 3, 3]);
        assert_eq!([small.below(4), small.below(3)], [Some(3), None]);
        assert_eq!(Heights::new(Dimension::Quad, 5, 2).record_of(1), 2);
    }

    #[test]
    fn records_come_back() {
        for dimension in [Dimension::Quad, Dimension::Oct] {
            for value in [ValueType::new(SampleType::U8, 3), ValueType::new(SampleType::F32, 4)] {
                let layout =
                    PointeredLayout::new(TreeType::new(dimension, value), *run_levels(dimension).end(), 19);
                let representative = Value::from_bytes(&vec![9; value.size()]);
                let mut run = vec![0; 2 * layout.run.size];
                let values = vec![7; layout.run.children() * layout.width()];
                layout.run.write(
                    &mut run[..layout.run.size],
                    &values,
                    RecordHead { states: 1, skip: 2, dense: 0 },
                );
                let height = least_zone(dimension);
                for (targets, bytes) in [(vec![79_999, 12_288], 3), (vec![79_990], 1)] {
                    let bitmap = if targets.len() > 1 { 1 << 15 | 4 } else { 4 };
                    let mut record = Vec::new();
                    let pointers = Pointers { bitmap, targets };
                    layout.encode((80_000, height), representative, &pointers, &run, &mut record);
                    let parts = layout.parts(&record, height).unwrap();
                    assert_eq!((parts.bitmap, parts.pointer), (bitmap, bytes));
                    assert_eq!(parts.pointers(&record, 80_000), Some(pointers));
                    assert_eq!(parts.pointer(&record, 80_000, 3), Some(None));
                    assert_eq!(parts.pointer(&record, 0, 2), None);
                    assert_eq!((parts.run(&record), parts.end), (&run[..], record.len()));
                    assert_eq!(layout.representative(&record), Some(representative));
                    let short = layout.parts(&record[..record.len() - 1], height);
                    assert_eq!(short, Err(BadRecord::Short(record.len())));
                }
            }
        }
    }
}

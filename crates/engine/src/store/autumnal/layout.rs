//! The Autumnal record: an INNER node, the levels below it as a run, and pointers to deeper
//! records.
//!
//! Only nodes at certain heights have records: every second height, and the root ([`Heights`]). The
//! height of a node is the number of levels below it, so a cell has height 0. A record's height is
//! known from the pointer that leads to it. The height selects one of two forms (`w` is the size
//! of a value in bytes):
//!
//! ```text
//! height <= run levels: a run alone     height > run levels: a run with pointers
//! w bytes: representative               w bytes: representative
//! n bytes: run, down to the cells       1 byte: pointer size p, 1 to 8
//!                                       1 to 8 bytes: bitmap of the nodes `t` levels below
//!                                       p bytes per set bit: distance back to that node's record
//!                                       n bytes: run
//!                                       rest: zone, if the node has one
//! ```
//!
//! All integers are little-endian. `t` is 1 or 2, the distance to the next lower height that has
//! records. Bit `i` of the bitmap belongs to node `i` in Z order. The record of such a node starts
//! that many bytes before this one. `p` is the smallest size that holds the longest distance.
//!
//! A run has the records of a Goblin segment: `skip` of its first record is the record count, so
//! its size is `skip` times the record size. It may reach more levels down than its pointers do.
//! Every level can therefore be drawn from records that contribute many of its values.
//!
//! `formats.md` (sections 21 and 22) specifies both forms.

use std::ops::RangeInclusive;

use crate::store::records::{Descend, RecordLayout, descend_in};
use spinney_base::TreeType;
use spinney_base::space::Dimension;
use spinney_base::value::Value;
use spinney_container::Shape;

/// Levels between two consecutive heights that have records.
const STRIDE: u8 = 2;

/// Heights (levels above the cells) of the nodes that have records of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Heights {
    /// Levels of a full run. A node of at most this height is one run without pointers.
    pub(super) run: u8,
    /// Minimum height of nodes with zones; the root may be lower.
    zone: u8,
    /// Height of the root, which always has a record.
    root: u8,
}

impl Heights {
    /// Returns the heights for a tree of `depth` levels and for runs of `run` levels.
    pub(super) fn new(dimension: Dimension, run: u8, depth: u8) -> Heights {
        let above = least_zone(dimension).saturating_sub(run).next_multiple_of(STRIDE);
        Heights { run, zone: run + above, root: depth }
    }

    /// Returns the height of the node whose record contains the nodes of `height`.
    #[inline]
    pub(super) fn record_of(&self, height: u8) -> u8 {
        let above = height.saturating_sub(self.run).next_multiple_of(STRIDE);
        (self.run + above).min(self.root)
    }

    /// Returns the height of the nodes that a record of `height` points to, or `None` if it is a
    /// run without pointers.
    #[inline]
    pub(super) fn target_height(&self, height: u8) -> Option<u8> {
        let above = height.checked_sub(self.run + 1)?;
        Some(self.run + above / STRIDE * STRIDE)
    }

    /// Returns the number of levels in the run of a record of `height`.
    #[inline]
    pub(super) fn run_of(&self, height: u8) -> u8 {
        self.run.min(height)
    }

    /// Returns whether a record of `height` has a zone.
    #[inline]
    pub(super) fn has_zone(&self, height: u8) -> bool {
        height > self.run && height >= self.zone.min(self.root)
    }

    /// Returns a shape whose blocks are as large as the smallest nodes with zones, and which keeps
    /// all records of a block together.
    pub(super) fn shape(&self) -> Shape {
        Shape { depth: self.root, reach: self.zone, stride: 1, heavy_threshold: u32::MAX }
    }
}

/// Run levels that a file may have. The maximum (32 x 32 or 8 x 8 x 8 values) rewrites that many
/// values if one of them changes, but draws any level from records that contribute many of its
/// values. The minimum makes more subtrees equal, for files that store equal subtrees once.
pub(super) const fn run_levels(dimension: Dimension) -> RangeInclusive<u8> {
    match dimension {
        Dimension::Quad => STRIDE..=5,
        Dimension::Oct => STRIDE..=3,
    }
}

/// Minimum height of nodes with zones: 128 x 128 or 32 x 32 x 32 cells.
const fn least_zone(dimension: Dimension) -> u8 {
    *run_levels(dimension).end() + STRIDE
}

/// Maximum size of a pointer in bytes.
const MAX_POINTER: usize = 8;

/// Layout of the records of a tree.
#[derive(Clone)]
pub(super) struct PointeredLayout {
    /// Dimension (quadtree or octree) and value type.
    pub(super) form: TreeType,
    pub(super) heights: Heights,
    /// Layout of the run's records.
    pub(super) run: RecordLayout,
    /// Descent function for runs of this layout.
    pub(super) descend: Descend,
}

/// Pointers of a record to deeper records.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Pointers {
    /// Bit `i`: whether node `i`, in Z order, has a record.
    pub(super) bitmap: u64,
    /// Record address for each set bit, in ascending bit order.
    pub(super) targets: Vec<u64>,
}

/// Offsets of a record's fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct RecordFields {
    /// See [`Pointers`].
    bitmap: u64,
    /// Size of a pointer in bytes.
    pointer: u8,
    /// Offsets of the pointers, of the run, and of the end of the run.
    pointers_at: usize,
    run_at: usize,
    pub(super) end: usize,
}

/// Reason why bytes are not a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BadRecord {
    /// Too few bytes: at least this many are needed to continue.
    Short(usize),
    /// A field has an impossible value.
    Wrong,
}

impl PointeredLayout {
    /// Returns the layout for trees of `form` and `depth` with runs of `run_levels` levels.
    pub(super) fn new(form: TreeType, run_levels: u8, depth: u8) -> PointeredLayout {
        let (heights, run) = (Heights::new(form.dimension, run_levels, depth), RecordLayout::new(form));
        PointeredLayout { form, heights, run, descend: descend_in(run) }
    }

    /// Returns the size in bytes of a bitmap with one bit per node `levels` below a node.
    #[inline]
    fn bitmap_size(&self, levels: u8) -> usize {
        self.form.dimension.cells(levels).div_ceil(8) as usize
    }

    /// Returns the size in bytes of the bitmap of a record of `height`, or `None` if it has no
    /// pointers.
    pub(super) fn bitmap_bytes(&self, height: u8) -> Option<usize> {
        self.heights.target_height(height).map(|target_height| self.bitmap_size(height - target_height))
    }

    /// Returns the size of a value in bytes.
    #[inline]
    pub(super) fn width(&self) -> usize {
        self.run.width
    }

    /// Returns the representative at the start of a record, or `None` if the record is truncated.
    #[inline]
    pub(super) fn representative(&self, record: &[u8]) -> Option<Value> {
        Value::read(record, self.width())
    }

    /// Locates the fields of a record of `height` and checks their ranges.
    #[inline]
    pub(super) fn fields(&self, record: &[u8], height: u8) -> Result<RecordFields, BadRecord> {
        let width = self.width();
        let mut fields =
            RecordFields { bitmap: 0, pointer: 0, pointers_at: width, run_at: width, end: width };
        if let Some(target_height) = self.heights.target_height(height) {
            let size = self.bitmap_size(height - target_height);
            fields.pointers_at = width + 1 + size;
            let head = record.get(width..fields.pointers_at).ok_or(BadRecord::Short(fields.pointers_at))?;
            fields.pointer = head[0];
            let mut bitmap = [0; size_of::<u64>()];
            bitmap[..size].copy_from_slice(&head[1..]);
            fields.bitmap = u64::from_le_bytes(bitmap);
            let nodes = self.form.dimension.cells(height - target_height);
            let is_good = (1..=MAX_POINTER).contains(&usize::from(fields.pointer))
                && fields.bitmap & !(u64::MAX >> (64 - nodes)) == 0;
            if !is_good {
                return Err(BadRecord::Wrong);
            }
            fields.run_at =
                fields.pointers_at + fields.bitmap.count_ones() as usize * usize::from(fields.pointer);
        }
        let first = fields.run_at + self.run.size;
        let head = record.get(fields.run_at..first).ok_or(BadRecord::Short(first))?;
        let skip = self.run.head(head, 0).ok_or(BadRecord::Wrong)?.skip;
        // A tree without uniform nodes has 1 + c + c^2 + ... records for c children.
        let levels = self.heights.run_of(height);
        let most = (self.form.dimension.cells(levels) - 1) / (self.form.children() as u64 - 1);
        if !(1..=most).contains(&u64::from(skip)) {
            return Err(BadRecord::Wrong);
        }
        fields.end = fields.run_at + skip as usize * self.run.size;
        if fields.end > record.len() { Err(BadRecord::Short(fields.end)) } else { Ok(fields) }
    }

    /// Appends a record without its zone to `buffer`. The record is to be stored at `address`, and
    /// all pointers must lead to lower addresses. A record without pointers ignores `pointers`.
    pub(super) fn encode(
        &self,
        (address, height): (u64, u8),
        representative: Value,
        Pointers { bitmap, targets }: &Pointers,
        run: &[u8],
        buffer: &mut Vec<u8>,
    ) {
        buffer.extend_from_slice(&representative.to_bytes()[..self.width()]);
        if let Some(target_height) = self.heights.target_height(height) {
            // The smallest size that holds the longest distance.
            let longest = targets.iter().map(|target| address - target).max().unwrap_or(1);
            let bytes = (8 - longest.leading_zeros() as usize / 8).max(1);
            buffer.push(bytes as u8);
            buffer.extend_from_slice(&bitmap.to_le_bytes()[..self.bitmap_size(height - target_height)]);
            for target in targets {
                buffer.extend_from_slice(&(address - target).to_le_bytes()[..bytes]);
            }
        }
        buffer.extend_from_slice(run);
    }
}

impl RecordFields {
    /// Returns the run of a record.
    #[inline]
    pub(super) fn run<'r>(&self, record: &'r [u8]) -> &'r [u8] {
        &record[self.run_at..self.end]
    }

    /// Returns the offset of the run in the record.
    pub(super) fn run_start(&self) -> usize {
        self.run_at
    }

    /// Returns the address that the pointer for `node` leads to, in a record at `address`. The
    /// outer option is `None` if the pointer does not lead back, the inner one if `node` has no
    /// pointer.
    #[inline]
    pub(super) fn pointer(&self, record: &[u8], address: u64, node: usize) -> Option<Option<u64>> {
        if self.bitmap >> node & 1 == 0 {
            return Some(None);
        }
        let before = (self.bitmap & ((1 << node) - 1)).count_ones() as usize;
        let size = usize::from(self.pointer);
        let mut distance = [0; MAX_POINTER];
        distance[..size].copy_from_slice(&record[self.pointers_at + before * size..][..size]);
        // Records only point back, so following pointers always terminates.
        let distance = u64::from_le_bytes(distance);
        let target = address.checked_sub(distance).filter(|_| distance > 0)?;
        Some(Some(target))
    }

    /// Returns all pointers of a record at `address`, or `None` if one of them does not lead back.
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
        let targets = [16, 15, 13, 7, 5].map(|height| heights.target_height(height));
        assert_eq!(targets, [Some(15), Some(13), Some(11), Some(5), None]);
        let small = Heights::new(Dimension::Oct, 3, 4);
        assert_eq!([4, 3, 1].map(|height| small.record_of(height)), [4, 3, 3]);
        assert_eq!([small.target_height(4), small.target_height(3)], [Some(3), None]);
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
                    let fields = layout.fields(&record, height).unwrap();
                    assert_eq!((fields.bitmap, fields.pointer), (bitmap, bytes));
                    assert_eq!(fields.pointers(&record, 80_000), Some(pointers));
                    assert_eq!(fields.pointer(&record, 80_000, 3), Some(None));
                    assert_eq!(fields.pointer(&record, 0, 2), None);
                    assert_eq!((fields.run(&record), fields.end), (&run[..], record.len()));
                    assert_eq!(layout.representative(&record), Some(representative));
                    let short = layout.fields(&record[..record.len() - 1], height);
                    assert_eq!(short, Err(BadRecord::Short(record.len())));
                }
            }
        }
    }
}

//! Entries of segments and top nodes, as shard summaries store them.

use std::collections::VecDeque;

use zerocopy::little_endian::{U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::deferred::file_order;
use super::directory::{Entry, entry_size};
use super::entry_columns::{TOGETHER, pack_entries, unpack_entries};
use crate::store::builder::{EncodedSubtree, upper_levels};
use crate::store::records::{RecordLayout, RunChildren, RunNode, Runs};
use crate::tree::{Child, NodeState};
use spinney_base::Result;
use spinney_base::space::{Bounds, Code, CodeRange};
use spinney_base::value::{Value, ValueType, ZoneStats};
use spinney_container::{
    Codec, Header, INNER, LEAF, LevelCounts, RangeSummary, Shape, ShardSummary, SummaryBytes, SummaryWriter,
    VOID,
};
use spinney_packing::{Corruption, SegmentForm, may_unpack, pack, unpack};

/// The first byte of entries, and of a part.
const SEGMENTS: u8 = 1;
const TOP: u8 = 2;
/// Size in bytes of a class's number of cells.
const CELLS: usize = 8;

/// The start of a part. Then follow an entry with its code and statistics, class counts, and
/// records.
#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawSubtree {
    total: U64,
    value: [u8; 16],
    state: u8,
    zero: [u8; 3],
    classes: U32,
    /// Size of the records in bytes.
    records: U64,
    /// Size of the records as stored, in bytes: smaller if they are packed.
    stored: U64,
}

/// An item of a shard's run of a layer, in file order.
pub(super) enum Item {
    /// The next segment of the run file.
    Segment(Entry),
    /// The part of a node that is merged with its siblings; its segments precede it.
    Top(EncodedSubtree),
}

/// The start of several entries of segments, which are packed unless that is larger.
#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
struct RawEntries {
    count: U32,
    stored: U32,
}

/// Entries of a run file's segments that a shard summary stores together.
#[derive(Default)]
pub(super) struct PendingEntries(Vec<u8>);

impl PendingEntries {
    /// Adds the next entry. Its offset is the end of the previous segment, and is not stored.
    pub(super) fn push(&mut self, summary: &mut SummaryWriter<LevelCounts>, entry: Entry) -> Result<()> {
        let value_type = entry.zone.value_type;
        self.0.extend_from_slice(&Entry { offset: 0, ..entry }.to_bytes());
        if self.0.len() < TOGETHER * entry_size(value_type) {
            Ok(())
        } else {
            self.write(summary, value_type)
        }
    }

    /// Writes the entries added so far.
    pub(super) fn write(
        &mut self,
        summary: &mut SummaryWriter<LevelCounts>,
        value_type: ValueType,
    ) -> Result<()> {
        let entries = std::mem::take(&mut self.0);
        if entries.is_empty() {
            return Ok(());
        }
        let packed = pack_entries(value_type, &entries);
        let stored = if packed.len() < entries.len() { &packed } else { &entries };
        let count = ((entries.len() / entry_size(value_type)) as u32).into();
        let raw = RawEntries { count, stored: (stored.len() as u32).into() };
        summary.write(&[&[SEGMENTS], raw.as_bytes(), stored].concat())
    }
}

/// Returns the description of a part's records that packing needs: those of a segment that reaches
/// as deep as the next coarser segments do.
fn form_of(header: &Header, node: Code) -> SegmentForm {
    let Header { form, rule, kind, shape, .. } = *header;
    SegmentForm {
        form,
        rule,
        kind,
        height: shape.depth - node.level(),
        reach: wanted_levels(&shape, node.level()),
    }
}

/// Returns the maximum number of levels that segments above a node have of it, if they do not have
/// all.
fn wanted_levels(shape: &Shape, level: u8) -> u8 {
    shape.cut_level(shape.parent_segment_level(level)).saturating_sub(level)
}

/// Writes the part of a node. Its records are packed, whatever the codec of the file, because they
/// are a large fraction of a summary.
pub(super) fn write_top(
    summary: &mut SummaryWriter<LevelCounts>,
    part: &EncodedSubtree,
    header: &Header,
) -> Result<()> {
    let EncodedSubtree { code, child, total, records, tally } = part;
    let slots = RecordLayout::new(header.form).count(records) as u32;
    let packed = pack(&form_of(header, *code), slots, records)
        .filter(|packed| may_unpack(packed.len() as u64, records.len() as u64));
    let stored = packed.as_deref().unwrap_or(records);
    let raw = RawSubtree {
        total: (*total).into(),
        value: child.value().unwrap_or_default().to_bytes(),
        state: child.state() as u8,
        zero: [0; 3],
        classes: (tally.classes.len() as u32).into(),
        records: (records.len() as u64).into(),
        stored: (stored.len() as u64).into(),
    };
    let (code, zone) = (*code, ZoneStats { classes: Vec::new(), ..tally.clone() });
    let entry =
        Entry { code, offset: 0, length: 0, records: 0, classes: 0, codec: Codec::Plain, checksum: 0, zone };
    let mut bytes = [&[TOP], raw.as_bytes(), &entry.to_bytes()].concat();
    for (value, cells) in &tally.classes {
        bytes.extend_from_slice(&value.to_bytes()[..tally.value_type.size()]);
        bytes.extend_from_slice(&cells.to_le_bytes());
    }
    summary.write(&bytes)?;
    summary.write(stored)
}

/// Reads the entries and parts of a shard's run of a layer, and checks each.
pub(super) struct Items<'h> {
    header: &'h Header,
    bytes: SummaryBytes,
    run: CodeRange,
    run_bytes: u64,
    /// Size of the segments so far, in bytes.
    position: u64,
    /// File order of the last segment.
    last_segment: Option<u64>,
    /// The last code below the last part's node.
    last_top: Option<u64>,
    /// Number of entries so far, for messages.
    count: usize,
    /// Unpacked entries that have not been returned yet.
    unpacked: VecDeque<Entry>,
}

impl<'h> Items<'h> {
    /// Returns the items of a shard's run of a layer with this header.
    pub(super) fn of(
        summary: &ShardSummary<LevelCounts>,
        range: &RangeSummary<LevelCounts>,
        header: &'h Header,
    ) -> Result<Items<'h>> {
        let (bytes, run, run_bytes) = (summary.bytes_of(range)?, range.range.run, range.run_bytes);
        let (last_segment, last_top) = (None, None);
        let unpacked = VecDeque::new();
        Ok(Items { header, bytes, run, run_bytes, position: 0, last_segment, last_top, count: 0, unpacked })
    }

    /// Returns the next item; `None` after the last.
    ///
    /// # Errors
    /// If the bytes are no valid item, or the item cannot be one of this run.
    pub(super) fn next(&mut self) -> Result<Option<Item>> {
        loop {
            if let Some(entry) = self.unpacked.pop_front() {
                return self.segment(entry).map(|entry| Some(Item::Segment(entry)));
            }
            if self.bytes.is_over() {
                return match self.position == self.run_bytes {
                    true => Ok(None),
                    false => {
                        let found = format!("segments of {} bytes", self.position);
                        Err(self.bytes.corrupt(found, format!("{} bytes", self.run_bytes)))
                    }
                };
            }
            match self.bytes.array::<1>()?[0] {
                SEGMENTS => self.unpack_entries()?,
                TOP => return self.top().map(|part| Some(Item::Top(part))),
                other => {
                    return Err(self.bytes.corrupt(format!("item type {other}"), "entries or a subtree"));
                }
            }
        }
    }

    fn entry(&mut self, bytes: &[u8]) -> Result<Entry> {
        self.count += 1;
        Entry::from_bytes(self.bytes.path(), self.count - 1, bytes, self.header.form)
    }

    /// Reads several entries, which are returned one by one.
    fn unpack_entries(&mut self) -> Result<()> {
        let raw: RawEntries = zerocopy::transmute!(self.bytes.array::<{ size_of::<RawEntries>() }>()?);
        let (count, value_type) = (raw.count.get() as usize, self.header.form.value);
        let stored = self.bytes.take(u64::from(raw.stored.get()))?;
        let size = entry_size(value_type);
        let entries = match count {
            1..=TOGETHER if stored.len() == count * size => Some(stored),
            1..=TOGETHER => unpack_entries(value_type, count, &stored),
            _ => None,
        };
        let Some(entries) = entries else {
            return Err(self.bytes.corrupt(format!("{count} invalid packed entries"), "entries of segments"));
        };
        for entry in entries.chunks_exact(size) {
            let entry = self.entry(entry)?;
            self.unpacked.push_back(entry);
        }
        Ok(())
    }

    /// Checks the next entry, and sets its segment's offset.
    fn segment(&mut self, entry: Entry) -> Result<Entry> {
        let shape = &self.header.shape;
        let order = file_order(entry.code, shape.shard_level());
        let level = entry.code.level();
        let owns = level == 0 || shape.is_candidate(level);
        let follows = self.last_segment.is_none_or(|last| last < order);
        let end = self.position.checked_add(entry.length).filter(|end| *end <= self.run_bytes);
        let is_alike = match self.header.is_referenced(level) {
            true => entry.codec == Codec::Reference,
            false => {
                entry.codec == Codec::Plain
                    || entry.codec == Codec::Packed && self.header.codec != Codec::Plain
            }
        };
        let is_here = level >= shape.shard_level() && self.run.contains(entry.code);
        let Some(end) = end.filter(|_| owns && follows && is_alike && is_here) else {
            let found = format!("a segment of node {} with {} bytes", entry.code, entry.length);
            return Err(self.bytes.corrupt(found, "the next segment of this run"));
        };
        let offset = std::mem::replace(&mut self.position, end);
        self.last_segment = Some(order);
        Ok(Entry { offset, ..entry })
    }

    fn top(&mut self) -> Result<EncodedSubtree> {
        let raw: RawSubtree = zerocopy::transmute!(self.bytes.array::<{ size_of::<RawSubtree>() }>()?);
        let entry = self.bytes.take(entry_size(self.header.form.value) as u64)?;
        let Entry { code, mut zone, .. } = self.entry(&entry)?;
        let width = zone.value_type.size();
        let classes = self.bytes.take(u64::from(raw.classes.get()) * (width + CELLS) as u64)?;
        zone.classes = classes.chunks_exact(width + CELLS).map(|class| class_of(class, width)).collect();
        let value = Value::from_bytes(&raw.value[..width]);
        let child = match raw.state {
            VOID => Some(Child::Void),
            LEAF => Some(Child::Leaf(value)),
            INNER => Some(Child::Inner { representative: value, node: () }),
            _ => None,
        };
        let stored = self.bytes.take(raw.stored.get())?;
        let records = self.records_of(code, raw.records.get(), stored)?;
        let wrong = |what: &str| {
            let found = format!("the subtree of node {code} with {what}");
            self.bytes.corrupt(found, "a valid subtree of this run")
        };
        let Some(child) = child else { return Err(wrong("an invalid state")) };
        self.check_place(code, child.state()).map_err(&wrong)?;
        let part = EncodedSubtree { code, child, total: raw.total.get(), records, tally: zone };
        self.check_part(&part).map_err(wrong)?;
        self.last_top = Some(code.last_bits());
        Ok(part)
    }

    /// Returns `length` bytes of a part's records from the stored bytes.
    fn records_of(&self, code: Code, length: u64, stored: Vec<u8>) -> Result<Vec<u8>> {
        if length == stored.len() as u64 {
            return Ok(stored);
        }
        let size = RecordLayout::new(self.header.form).size as u64;
        let slots = u32::try_from(length / size).ok().filter(|_| length.is_multiple_of(size));
        let may = code.level() <= self.header.depth() && may_unpack(stored.len() as u64, length);
        let unpacked = slots.filter(|_| may).map(|slots| {
            unpack(&form_of(self.header, code), slots, 0, &stored).map_err(|Corruption(what)| what)
        });
        unpacked.unwrap_or(Err("too many unpacked bytes")).map_err(|what| {
            let found = format!("records of node {code} in {} bytes: {what}", stored.len());
            self.bytes.corrupt(found, format!("{length} packed bytes"))
        })
    }

    /// Checks whether the next part may be that of this node.
    fn check_place(&self, code: Code, state: NodeState) -> Result<(), &'static str> {
        let shape = &self.header.shape;
        let shard_level = shape.shard_level();
        if !self.run.contains(code) {
            return Err("a position outside of the run");
        }
        if self.last_top.is_some_and(|last| code.bits() <= last) {
            return Err("a position before the end of the previous subtree");
        }
        // Invariant: parts above `shard_level` are those of uniform nodes, since a shard merges
        // nothing above it.
        if code.level() > shard_level || code.level() < shard_level && state == NodeState::Inner {
            return Err("another level than the shard level");
        }
        if !has_cells(code, self.header) {
            return Err("no cell in the extent");
        }
        Ok(())
    }

    fn check_part(&self, part: &EncodedSubtree) -> Result<(), &'static str> {
        let Header { form, shape, .. } = self.header;
        let tally = &part.tally;
        let cells = form.dimension.cells(shape.depth - part.code.level());
        let is_possible = match part.child.state() {
            NodeState::Void => tally.cells == 0,
            NodeState::Leaf => tally.cells == cells,
            NodeState::Inner => tally.cells <= cells && part.code.level() < shape.depth,
        };
        let has_all = tally.present.iter().all(|present| *present <= tally.cells);
        if !is_possible || !has_all || !tally.sum.are_possible(cells) {
            return Err("invalid cell counts");
        }
        if !are_classes(&tally.classes, tally, self.header.counts_classes()) {
            return Err("invalid class counts");
        }
        let has_records =
            if part.child.is_inner() { are_records(part, self.header) } else { part.records.is_empty() };
        if has_records { Ok(()) } else { Err("inconsistent records") }
    }
}

/// Returns whether a node has cells within the extent.
pub(super) fn has_cells(code: Code, header: &Header) -> bool {
    let (cells, extent) = (code.bounds(header.depth()), Bounds::of_extent(header.extent));
    (0..3).all(|axis| cells.min[axis] < extent.max[axis])
}

fn class_of(class: &[u8], width: usize) -> (Value, u64) {
    let (value, cells) = class.split_at(width);
    (Value::from_bytes(value), u64::from_le_bytes(cells.try_into().expect("8 bytes")))
}

/// Returns whether these can be the classes of a zone.
fn are_classes(classes: &[(Value, u64)], zone: &ZoneStats, are_counted: bool) -> bool {
    let order = |value_type: ValueType, pair: &[(Value, u64)]| value_type.order(pair[0].0, pair[1].0).is_lt();
    let ascend = classes.windows(2).all(|pair| order(zone.value_type, pair));
    let sum = classes.iter().try_fold(0u64, |sum, (_, cells)| sum.checked_add(*cells));
    classes.is_empty() || are_counted && ascend && sum == Some(zone.cells)
}

/// Returns whether the records of a part are those of an INNER node's upper levels, as its
/// ancestors' segments need them.
fn are_records(part: &EncodedSubtree, header: &Header) -> bool {
    let (level, shape) = (part.code.level(), &header.shape);
    if level == 0 {
        // All of them are in the root's segment.
        return part.records.is_empty();
    }
    let layout = RecordLayout::new(header.form);
    let wanted = wanted_levels(shape, level);
    let slots = layout.count(&part.records);
    let is_whole = slots * layout.size == part.records.len()
        && layout.head(&part.records, 0).is_some_and(|head| head.skip as usize == slots);
    is_whole
        && upper_levels(header.form, &part.records, wanted).is_ok()
        && can_be_walked(&layout, &part.records, shape.depth - level)
}

/// Returns whether all records are reachable from the first one, within at most `levels` levels.
fn can_be_walked(layout: &RecordLayout, records: &[u8], levels: u8) -> bool {
    let mut pending = vec![(RunNode::default(), levels)];
    let mut children = RunChildren::default();
    let mut slots = 0;
    while let Some((node, levels)) = pending.pop() {
        if levels == 0 || layout.run_children(records, node, &mut children).is_none() {
            return false;
        }
        if node.below == 0 {
            let head = layout.head(records, node.record as usize).expect("its children were read");
            slots += if head.dense == 0 { 1 } else { head.skip as usize };
        }
        let inner = children[..layout.children()].iter().filter(|child| child.state == INNER);
        pending.extend(inner.map(|child| (child.node, levels - 1)));
    }
    slots == layout.count(records)
}

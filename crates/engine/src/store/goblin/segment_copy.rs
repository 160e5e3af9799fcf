//! Copies the stored segments below a node from one file to another, without building them.

use std::any::Any;
use std::sync::Arc;

use super::directory::{Entry, NOT_COUNTED};
use super::packed::{are_packed_alike, pack_bytes};
use super::reader::Goblin;
use super::segment::Segment;
use super::segment_sink::SegmentSink;
use crate::store::builder::{ALWAYS_HEAVY, EncodedSubtree, StoredNode, upper_levels};
use crate::store::records::subtree::{BadSkip, count_nodes};
use crate::store::records::{RunChildren, RunNode, Runs};
use crate::tree::Child;
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::io::FileBytes;
use spinney_base::parallel;
use spinney_base::space::Code;
use spinney_base::value::Value;
use spinney_container::{CUT, Codec, Header, INNER, LevelCounts, Shape};

/// A node of a file that owns a segment, to be copied to another node.
pub(super) struct SegmentCopy<'a> {
    file: &'a Goblin,
    from: Code,
    to: Code,
    /// Index of the segment that the node owns.
    own: usize,
    /// Segments of the node and of its descendants, a node's before its ancestors'.
    segments: Vec<usize>,
}

/// A segment that was counted, and thereby checked, with the bytes to be written.
struct ReadySegment<'a> {
    counts: LevelCounts,
    entry: Entry,
    bytes: FileBytes<'a>,
}

fn send_some(segments: &[ReadySegment<'_>], sink: &mut dyn SegmentSink) -> Result<()> {
    segments.iter().try_for_each(|segment| sink.copy(&segment.bytes, segment.entry.clone()))
}

/// Number of segments that are checked and counted at a time: few enough to be in the processor's
/// cache when they are written.
const BATCH: usize = 8;

/// Returns the Goblin file of a node.
fn file_of<'a>(node: &StoredNode<'a>) -> Option<&'a Goblin> {
    let file: &'a dyn Any = node.file;
    file.downcast_ref()
}

impl<'a> SegmentCopy<'a> {
    /// Returns whether a node and its subtree can be copied to the node `to` of a tree. The node
    /// must own a segment, and so will `to`, with the same segments below; and the file must have
    /// its class counts if they are needed.
    pub(super) fn is_possible(
        node: &StoredNode<'_>,
        to: Code,
        (form, shape): (TreeType, &Shape),
        needs_classes: bool,
    ) -> Result<bool> {
        let Some(file) = file_of(node) else { return Ok(false) };
        let there = file.header();
        let is_alike = there.form == form
            && there.shape.is_cut_like(shape)
            && Some(node.height) == shape.depth.checked_sub(to.level());
        // A root owns a segment even if it is not heavy.
        let is_root = node.height == there.depth();
        if !is_alike || !shape.is_candidate(to.level()) || is_root || node.record != 0 {
            return Ok(false);
        }
        let segment = node.run as usize;
        let own = file.segment_code(segment)?.filter(|own| own.level() + node.height == there.depth());
        // Invariant: references are copied to indexes only, since `is_cut_like` compares heavy
        // thresholds, which are 0 in indexes alone. The caller ensures that the other index has the
        // same sources.
        Ok(own.is_some() && !(needs_classes && file.entry(segment)?.classes == NOT_COUNTED))
    }

    /// Returns the segments to be copied; `None` if the node is not in a Goblin file.
    pub(super) fn of(node: &StoredNode<'a>, to: Code) -> Result<Option<SegmentCopy<'a>>> {
        let Some(file) = file_of(node) else { return Ok(None) };
        let own = node.run as usize;
        let from = file.entry(own)?.code;
        Ok(Some(SegmentCopy { file, from, to, own, segments: below(file, own, from)? }))
    }

    /// Passes the segments to the sink of a tree with this header, and returns their node counts
    /// per level. While some segments are written, the next are counted, and packed or unpacked if
    /// the trees differ in that.
    pub(super) fn send(&self, header: &Header, sink: &mut dyn SegmentSink) -> Result<LevelCounts> {
        // A pipeline of two stages, which the empty batch at the end drains. Invariant: a segment
        // is sent only after it was counted, since counting checks it. Otherwise inconsistent
        // records could be in a new file, with valid checksums.
        let mut counts = LevelCounts::default();
        let mut ready = Vec::new();
        let codec = sink.codec();
        for next in self.segments.chunks(BATCH).chain([&[][..]]) {
            let (sent, made) =
                parallel::join(|| send_some(&ready, sink), || self.make_ready(next, header, codec));
            sent?;
            ready = made?;
            ready.iter().for_each(|ready| counts.merge(&ready.counts));
        }
        Ok(counts)
    }

    fn make_ready(&self, segments: &[usize], header: &Header, codec: Codec) -> Result<Vec<ReadySegment<'a>>> {
        let made = parallel::map(segments, |index| self.ready_segment(*index, header, codec));
        made.into_iter().collect()
    }

    /// Counts a segment, and returns its bytes for the tree with this header.
    fn ready_segment(&self, index: usize, header: &Header, codec: Codec) -> Result<ReadySegment<'a>> {
        let mut entry = self.file.entry(index)?;
        if entry.codec == Codec::Reference && codec == Codec::Reference {
            let counts = self.count_reference(index, &entry)?;
            entry.code = moved(entry.code, self.from, self.to);
            return Ok(ReadySegment { counts, entry, bytes: self.file.stored_segment(index)? });
        }
        let segment = self.file.segment(index)?;
        let counts = self.count_segment(index, &segment)?;
        entry.code = moved(entry.code, self.from, self.to);
        let (codec, bytes) = match (entry.codec, codec) {
            (Codec::Plain, Codec::Plain) => {
                return Ok(ReadySegment { counts, entry, bytes: segment.into_bytes() });
            }
            (Codec::Packed, Codec::Packed | Codec::Reference)
                if are_packed_alike(self.file.header(), header) =>
            {
                let bytes = self.file.stored_segment(index)?;
                return Ok(ReadySegment { counts, entry, bytes });
            }
            (_, Codec::Plain) => (Codec::Plain, segment.into_bytes()),
            (_, Codec::Packed | Codec::Reference) => {
                match pack_bytes(header, entry.code, entry.records, segment.all_bytes()) {
                    Some(packed) => (Codec::Packed, FileBytes::Cached(Arc::new(packed).into())),
                    None => (Codec::Plain, segment.into_bytes()),
                }
            }
        };
        (entry.codec, entry.length, entry.checksum) = (codec, bytes.len() as u64, crc32c::crc32c(&bytes));
        Ok(ReadySegment { counts, entry, bytes })
    }

    /// Returns the part that the node's ancestors are merged from, in a tree of this shape.
    pub(super) fn part(&self, representative: Value, shape: &Shape) -> Result<EncodedSubtree> {
        let cut = shape.cut_level(shape.parent_segment_level(self.to.level()));
        let levels = cut.saturating_sub(self.to.level());
        let form = self.file.header().form;
        // Checked here, because counting skips these records: it counts the copies of them in
        // deeper segments.
        let records = match self.file.entry(self.own)?.codec {
            Codec::Reference => {
                let (segment, record) = self.file.stored_above(self.from)?;
                let (layout, stored) = (self.file.layout(), segment.records());
                let head = layout.head(stored, record);
                let run = head.and_then(|head| layout.subtree(stored, record, head.skip));
                run.and_then(|run| upper_levels(form, run, levels).ok())
                    .ok_or_else(|| self.file.bad_skip(&segment, record))?
            }
            _ => {
                let segment = self.file.segment(self.own)?;
                upper_levels(form, segment.records(), levels)
                    .map_err(|BadSkip| self.file.bad_skip(&segment, 0))?
            }
        };
        Ok(EncodedSubtree {
            code: self.to,
            child: Child::Inner { representative, node: () },
            // Heavy enough that it and its ancestors keep their segments, whatever else is below
            // them.
            total: ALWAYS_HEAVY,
            records,
            tally: self.file.zone(self.own)?,
        })
    }

    /// Counts the nodes below a segment's records that no deeper segment has, at their new levels.
    fn count_segment(&self, index: usize, segment: &Segment<'_>) -> Result<LevelCounts> {
        let (layout, shape) = (self.file.layout(), &self.file.header().shape);
        let records = segment.records();
        let mut counts = LevelCounts::default();
        let mut pending = vec![(segment.code(), RunNode::default())];
        while let Some((code, at)) = pending.pop() {
            // Nodes from this level on own no segments: their whole subtree is here.
            if code.level() >= shape.block_level() {
                self.count_inline(segment, code, at, &mut counts)?;
                continue;
            }
            let mut children = RunChildren::default();
            let read = layout.run_children(records, at, &mut children);
            read.ok_or_else(|| self.file.bad_skip(segment, at.record as usize))?;
            let candidates = shape.is_candidate(code.level() + 1);
            let mut nodes = [0; 3];
            for (step, child) in children[..layout.children()].iter().enumerate() {
                // CUT counts as INNER: the location of an INNER node's record does not matter.
                nodes[usize::from(child.state.min(INNER))] += 1;
                if child.state < INNER {
                    continue;
                }
                let (code, is_cut, place) = (code.child(step), child.state == CUT, child.node);
                let found = if candidates { self.file.find_segment(code)? } else { None };
                match found {
                    // It is counted with its own segment.
                    Some(found) if found != index && self.file.entry(found)?.code == code => {}
                    _ if is_cut => return Err(self.file.bad_cut(code)),
                    // It is a candidate without a segment of its own: its subtree is inline.
                    _ if candidates => self.count_inline(segment, code, place, &mut counts)?,
                    _ => pending.push((code, place)),
                }
            }
            counts.add(self.new_level(code.level() + 1), nodes);
        }
        Ok(counts)
    }

    /// Counts the nodes below a node whose segment is a reference: those that the segment above
    /// has, and the numbers in the reference.
    fn count_reference(&self, index: usize, entry: &Entry) -> Result<LevelCounts> {
        let (header, code) = (self.file.header(), entry.code);
        let reference = self.file.reference(index, entry)?;
        let (segment, record) = self.file.stored_above(code)?;
        let (layout, mut counts) = (self.file.layout(), LevelCounts::default());
        let first = self.new_level(code.level());
        let mut nodes = vec![RunNode::of_record(record)];
        let stored = header.depth() - code.level() - header.shape.stride;
        for below in 1..=stored {
            let (mut sums, mut deeper) = ([0; 3], Vec::new());
            for node in nodes {
                let mut children = RunChildren::default();
                let read = layout.run_children(segment.records(), node, &mut children);
                read.ok_or_else(|| self.file.bad_skip(&segment, record))?;
                for child in &children[..layout.children()] {
                    sums[usize::from(child.state.min(INNER))] += 1;
                    if child.state >= INNER {
                        if child.state == CUT && below < stored {
                            return Err(self.file.bad_cut(code));
                        }
                        deeper.push(child.node);
                    }
                }
            }
            counts.add(first + below, sums);
            nodes = deeper;
        }
        let mut parents = nodes.len() as u64;
        for (level, numbers) in (first + stored + 1..).zip(reference.nodes.chunks(2)) {
            let all = parents.saturating_mul(layout.children() as u64);
            let (inner, void) = if let [inner, void] = *numbers { (inner, void) } else { (0, numbers[0]) };
            let Some(leaves) = all.checked_sub(inner).and_then(|left| left.checked_sub(void)) else {
                let part = format!("segment {code} (entry {index})");
                let found = format!("{inner} INNER and {void} VOID nodes");
                return Err(self.file.corrupt(part, found, &format!("at most {all} nodes")));
            };
            counts.add(level, [void, leaves, inner]);
            parents = inner;
        }
        Ok(counts)
    }

    /// Counts the nodes below one whose whole subtree is in this segment.
    fn count_inline(
        &self,
        segment: &Segment<'_>,
        code: Code,
        node: RunNode,
        counts: &mut LevelCounts,
    ) -> Result<()> {
        let at = node.record as usize;
        let bad_skip = || self.file.bad_skip(segment, at);
        // (A candidate whose whole subtree is in this segment is never inside a dense block.)
        if node.below > 0 {
            return Err(bad_skip());
        }
        let (layout, records) = (self.file.layout(), segment.records());
        let head = layout.head(records, at).ok_or_else(bad_skip)?;
        let subtree = layout.subtree(records, at, head.skip).ok_or_else(bad_skip)?;
        let levels = self.file.header().depth().saturating_sub(code.level());
        count_nodes(*layout, subtree, levels, self.new_level(code.level()), counts).map_err(|_| bad_skip())
    }

    /// Returns the new level of nodes at a level.
    fn new_level(&self, level: u8) -> u8 {
        level + self.to.level() - self.from.level()
    }
}

/// Returns the node whose position below `to` is that of `code` below `from`.
fn moved(code: Code, from: Code, to: Code) -> Code {
    (from.level()..code.level()).fold(to, |node, level| node.child(code.step(level)))
}

/// Returns the segments of a node, whose own segment is `first`, and of its descendants. A node's
/// segment precedes its ancestors', the order in which the builder writes them.
fn below(file: &Goblin, first: usize, code: Code) -> Result<Vec<usize>> {
    let mut order = Vec::new();
    // Converts preorder, the order of the segment index, to postorder: a node is added when the
    // next one is not below it. The stack has the nodes that may still have descendants.
    let mut open: Vec<(usize, Code)> = Vec::new();
    for index in first..file.segments() {
        let next = file.entry(index)?.code;
        if !code.contains(next) {
            break;
        }
        while let Some((done, _)) = open.pop_if(|(_, above)| !above.contains(next)) {
            order.push(done);
        }
        open.push((index, next));
    }
    order.extend(open.into_iter().rev().map(|(index, _)| index));
    Ok(order)
}

//! Takes over what a file has stored below a node, segment by segment, without making it anew.

use super::assemble::SegmentSink;
use super::reader::Goblin;
use super::record::{INNER, LEAF, Layout, Record, VOID};
use super::segment::{Segment, child_places};
use super::shape::Shape;
use crate::Result;
use crate::parallel;
use crate::space::Code;
use crate::store::build::LevelCounts;
use crate::store::build::count_nodes;
use crate::store::build::{ENOUGH, Part, trim};
use crate::tree::{Child, Stored};
use crate::value::Value;

/// A node of a file that owns a segment, to be copied to another node.
pub(in crate::store) struct Copied<'a, D: Layout, V: Value> {
    from: Stored<'a, D, V>,
    to: Code<D>,
    /// Segments of the node and of what is below it, a node's before its ancestors'.
    segments: Vec<usize>,
    /// What the ancestors need of the node.
    pub(in crate::store) part: Part<D, V>,
}

/// Segments that are checked and counted at a time: few enough to be in the processor's cache when they are written.
const BATCH: usize = 8;

impl<'a, D: Layout, V: Value> Copied<'a, D, V> {
    /// What is to be copied, if the node owns a segment; both trees have the same shape.
    pub(in crate::store) fn of(
        from: Stored<'a, D, V>,
        to: Code<D>,
        representative: V,
        shape: &Shape,
    ) -> Result<Option<Copied<'a, D, V>>> {
        // A root owns a segment whether it is heavy or not.
        if !shape.is_candidate(to.level()) || from.node.code.level() == 0 {
            return Ok(None);
        }
        let Some(first) = from.file.find_segment(from.node.code) else { return Ok(None) };
        let own = from.file.segment(first)?;
        if own.code() != from.node.code {
            return Ok(None);
        }
        let segments = below(from.file, first, from.node.code)?;
        let mut records = Vec::new();
        let cut = shape.cut_level(shape.parent_segment_level(to.level()));
        trim::<D, V>(own.records(), 0, cut.saturating_sub(to.level()), &mut records);
        let part = Part {
            code: to,
            child: Child::Inner { representative, node: () },
            total: ENOUGH,
            records,
            tally: from.file.zone(first)?,
        };
        Ok(Some(Copied { from, to, segments, part }))
    }

    /// Hands the segments to a sink and tells their nodes per level: while some are written, the next are counted.
    pub(in crate::store) fn send(&self, sink: &mut (impl SegmentSink<D, V> + Send)) -> Result<LevelCounts> {
        let mut counts = LevelCounts::default();
        let mut ready: &[usize] = &[];
        for next in self.segments.chunks(BATCH).chain([&[][..]]) {
            let (sent, counted) = parallel::join(|| self.send_some(ready, sink), || self.count(next));
            sent?;
            counts.merge(&counted?);
            ready = next;
        }
        Ok(counts)
    }

    fn count(&self, segments: &[usize]) -> Result<LevelCounts> {
        let (file, from) = (self.from.file, self.from.node.code);
        let count = |index: &usize| count(file, &file.segment(*index)?, from, self.to);
        let mut counts = LevelCounts::default();
        for counted in parallel::map(segments, count) {
            counts.merge(&counted?);
        }
        Ok(counts)
    }

    fn send_some(&self, segments: &[usize], sink: &mut impl SegmentSink<D, V>) -> Result<()> {
        for index in segments {
            let segment = self.from.file.segment(*index)?;
            let mut entry = self.from.file.entry(*index)?;
            entry.code = moved(entry.code, self.from.node.code, self.to);
            sink.copy(&segment, entry)?;
        }
        Ok(())
    }
}

/// The node that lies below `to` as `code` lies below `from`.
fn moved<D: Layout>(code: Code<D>, from: Code<D>, to: Code<D>) -> Code<D> {
    (from.level()..code.level()).fold(to, |node, level| node.child(code.step(level)))
}

/// The segments of a node and of what is below it, a node's before its ancestors', as building writes them.
fn below<D: Layout, V: Value>(file: &Goblin<D, V>, first: usize, code: Code<D>) -> Result<Vec<usize>> {
    let mut order = Vec::new();
    let mut open: Vec<(usize, Code<D>)> = Vec::new();
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

/// Counts the nodes below the records that no deeper segment has, at the levels of their new place.
fn count<D: Layout, V: Value>(
    file: &Goblin<D, V>,
    segment: &Segment<'_, D, V>,
    from: Code<D>,
    to: Code<D>,
) -> Result<LevelCounts> {
    let mut counts = LevelCounts::default();
    let shape = &file.header().shape;
    let lower = |level: u8| level + to.level() - from.level();
    let records = segment.records();
    let depth = shape.depth;
    let whole = |code: Code<D>, at: usize, counts: &mut LevelCounts| {
        let subtree = records.get(at..at + records[at].skip() as usize).unwrap_or(&[]);
        count_nodes::<D, V>(subtree, depth.saturating_sub(code.level()), lower(code.level()), counts)
            .map_err(|_| file.bad_skip(segment, at))
    };
    let mut pending = vec![(segment.code(), 0)];
    while let Some((code, at)) = pending.pop() {
        if code.level() >= shape.block_level() {
            whole(code, at, &mut counts)?;
            continue;
        }
        let record = &records[at];
        let places = child_places::<D, V>(records, at).ok_or_else(|| file.bad_skip(segment, at))?;
        let candidates = shape.is_candidate(code.level() + 1);
        for (step, place) in places.as_ref().iter().enumerate() {
            let state = record.state(step);
            let node = match state {
                VOID => [1, 0, 0],
                LEAF => [0, 1, 0],
                _ => [0, 0, 1],
            };
            counts.add(lower(code.level() + 1), node);
            let Some(place) = place.filter(|_| state == INNER) else { continue };
            let child = code.child(step);
            if !candidates {
                pending.push((child, place as usize));
            } else if file.find_segment(child) == Some(segment.index()) {
                // It might own a segment and does not: all that is below it is here.
                whole(child, place as usize, &mut counts)?;
            }
        }
    }
    Ok(counts)
}

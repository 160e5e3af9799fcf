//! Parts: encoded subtrees, which are merged by four (or eight) on the way up, and sealed into
//! segments.

use super::upper::upper_levels;
use crate::store::records::subtree::BadSkip;
use crate::store::records::{RecordHead, RecordLayout};
use crate::tree::Child;
use spinney_base::TreeType;
use spinney_base::space::Code;
use spinney_base::value::{Rule, Value, ValueType, ZoneStats, representative};
use spinney_container::{CUT, LevelCounts, Shape};

/// A number of records that makes a node heavy in a file of any shape.
pub(in crate::store) const ALWAYS_HEAVY: u64 = u32::MAX as u64;

/// A node, and the records below it that coarser segments still need.
#[derive(Clone)]
pub(in crate::store) struct EncodedSubtree {
    pub(in crate::store) code: Code,
    pub(in crate::store) child: Child<()>,
    /// Records of the whole subtree, including those that were written and dropped;
    /// [`ALWAYS_HEAVY`] or more if they were not counted.
    pub(in crate::store) total: u64,
    /// Records in preorder: all of them, or those above a cut.
    pub(in crate::store) records: Vec<u8>,
    pub(in crate::store) tally: ZoneStats,
}

/// A segment ready to be written.
pub(in crate::store) struct SealedSegment {
    pub(in crate::store) code: Code,
    pub(in crate::store) records: Vec<u8>,
    pub(in crate::store) tally: ZoneStats,
    /// Packed records and class counts, if these are to be written instead.
    pub(in crate::store) packed: Option<Vec<u8>>,
}

/// Returns the uniform node that the children form if all are VOID, or all LEAFs of one value.
fn uniform_children<N>(mut children: impl Iterator<Item = Child<N>>) -> Option<Child<()>> {
    let first = children.next()?.map_node(|_| ());
    let alike = children.all(|child| match (first, child) {
        (Child::Void, Child::Void) => true,
        (Child::Leaf(a), Child::Leaf(b)) => a == b,
        _ => false,
    });
    (alike && !first.is_inner()).then_some(first)
}

/// Returns the representative of a node of `cells` cells from its children and the statistics of
/// its cells.
fn representative_of<N>(
    rule: Rule,
    children: impl Iterator<Item = Child<N>>,
    tally: &ZoneStats,
    cells: u64,
) -> Value {
    let mut values = [None; 8];
    for (value, child) in values.iter_mut().zip(children) {
        *value = child.value().map(|value| (value, child.is_inner()));
    }
    representative(rule, &values, tally, cells)
}

impl EncodedSubtree {
    /// Returns a uniform block: of one value, or VOID.
    pub(in crate::store) fn uniform(
        code: Code,
        depth: u8,
        value_type: ValueType,
        value: Option<Value>,
        count_classes: bool,
    ) -> Self {
        let cells = code.dimension().cells(depth - code.level());
        let tally = match value {
            None => ZoneStats::void(value_type),
            Some(value) => ZoneStats::leaf(value_type, value, cells, count_classes),
        };
        EncodedSubtree { code, child: Child::uniform(value), total: 0, records: Vec::new(), tally }
    }

    /// Returns the tree type.
    fn form(&self) -> TreeType {
        TreeType::new(self.code.dimension(), self.tally.value_type)
    }

    /// Returns the parent of these parts, which are all its children in order.
    pub(in crate::store) fn merge(
        code: Code,
        parts: &[EncodedSubtree],
        depth: u8,
        rule: Rule,
        counts: &mut LevelCounts,
    ) -> Self {
        let mut tally = ZoneStats::merge(&parts.iter().map(|part| &part.tally).collect::<Vec<_>>());
        let children = || parts.iter().map(|part| part.child);
        if let Some(child) = uniform_children(children()) {
            return EncodedSubtree { code, child, total: 0, records: Vec::new(), tally };
        }
        let layout = RecordLayout::new(parts[0].form());
        let mut states = 0;
        let mut tallied = [0; 3];
        let mut values = Vec::with_capacity(layout.children() * layout.width);
        for (i, child) in children().enumerate() {
            let state = child.state();
            // The records below a node may have been dropped.
            let is_cut = child.is_inner() && parts[i].records.is_empty();
            let stored = if is_cut { CUT } else { state as u8 };
            states |= u32::from(stored) << (2 * i);
            tallied[state as usize] += 1;
            values.extend_from_slice(&child.value().unwrap_or_default().to_bytes()[..layout.width]);
        }
        counts.add(code.level() + 1, tallied);
        let below = parts.iter().map(|part| part.records.len()).sum::<usize>();
        let skip = 1 + (below / layout.size) as u32;
        let mut records = Vec::with_capacity(layout.size + below);
        records.resize(layout.size, 0);
        // Invariant: merged parts always form a plain record. So the levels between a segment's
        // node and the next candidates, whose nodes may own segments, are never inside a dense
        // block. Readers find these segments record by record and could not find one below a dense
        // block.
        layout.write(&mut records, &values, RecordHead { states, skip, dense: 0 });
        parts.iter().for_each(|part| records.extend_from_slice(&part.records));
        let cells = code.dimension().cells(depth - code.level());
        let representative = representative_of(rule, children(), &tally, cells);
        tally.keep_listed_for(rule);
        EncodedSubtree {
            code,
            child: Child::Inner { representative, node: () },
            // Invariant: a node's total is at least that of each child (totals from files may be
            // incorrect, so the sum saturates instead of wrapping around). So candidates above a
            // heavy one are heavy, too. The search for a node's segment depends on this: it goes
            // from a segment's level to the next one up. And the remaining records of a sealed part
            // go into a segment that reaches no deeper than they do.
            total: parts.iter().fold(1, |sum, part| sum.saturating_add(part.total)),
            records,
            tally,
        }
    }

    /// Removes and returns the node's own segment, if it owns one. The remaining records are those
    /// that the next coarser segments need.
    ///
    /// # Errors
    /// If the records are inconsistent, as those of parts from a file may be.
    pub(in crate::store) fn seal(&mut self, shape: &Shape) -> Result<Option<SealedSegment>, BadSkip> {
        let mut is_bad = false;
        let sealed = self.seal_with(shape, |part, levels| {
            let upper = upper_levels(part.form(), &part.records, levels);
            is_bad = upper.is_err();
            upper.unwrap_or_default()
        });
        if is_bad { Err(BadSkip) } else { Ok(sealed) }
    }

    /// [`EncodedSubtree::seal`] with a function that returns the records of the node's first
    /// levels.
    pub(super) fn seal_with(
        &mut self,
        shape: &Shape,
        upper_levels: impl FnOnce(&EncodedSubtree, u8) -> Vec<u8>,
    ) -> Option<SealedSegment> {
        let level = self.code.level();
        let is_root = level == 0;
        let is_heavy = shape.is_candidate(level) && self.total > shape.heavy_threshold as u64;
        if !self.child.is_inner() || !(is_root || is_heavy) {
            return None;
        }
        let above = if is_root {
            Vec::new()
        } else {
            // Invariant: no segment above reaches deeper into this node than the next one does,
            // since all span the same number of levels. So records below that level are not needed
            // any more, and those above it are all present when the next segments are sealed. With
            // fewer records, those segments would lack nodes that no other segment has.
            let cut = shape.cut_level(shape.parent_segment_level(level));
            upper_levels(self, cut.saturating_sub(level))
        };
        let records = std::mem::replace(&mut self.records, above);
        Some(SealedSegment { code: self.code, records, tally: self.tally.clone(), packed: None })
    }
}

//! Parts of a tree on their way up: merged four (or eight) by four, sealed into segments.

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

/// A node and what coarser segments still need of the tree below it.
#[derive(Clone)]
pub(in crate::store) struct Part {
    pub(in crate::store) code: Code,
    pub(in crate::store) child: Child<()>,
    /// Records of the whole subtree, written and forgotten ones included; [`ALWAYS_HEAVY`] or more where
    /// nobody counted.
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
    /// Records and class counts in fewer bytes, where these are to be written instead.
    pub(in crate::store) packed: Option<Vec<u8>>,
}

/// The uniform node that children make together, if they are all VOID or all LEAFs of one value.
fn uniform_children<N>(mut children: impl Iterator<Item = Child<N>>) -> Option<Child<()>> {
    let first = children.next()?.map_node(|_| ());
    let alike = children.all(|child| match (first, child) {
        (Child::Void, Child::Void) => true,
        (Child::Leaf(a), Child::Leaf(b)) => a == b,
        _ => false,
    });
    (alike && !first.is_inner()).then_some(first)
}

/// The representative of a node of so many cells from its children and from the tally of what is below it.
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

impl Part {
    /// A block of one value, or VOID.
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
        Part { code, child: Child::uniform(value), total: 0, records: Vec::new(), tally }
    }

    /// The form of the tree.
    fn form(&self) -> TreeType {
        TreeType::new(self.code.dimension(), self.tally.value_type)
    }

    /// The parent of these parts, which are all its children in order.
    pub(in crate::store) fn merge(
        code: Code,
        parts: &[Part],
        depth: u8,
        rule: Rule,
        counts: &mut LevelCounts,
    ) -> Self {
        let mut tally = ZoneStats::merge(&parts.iter().map(|part| &part.tally).collect::<Vec<_>>());
        let children = || parts.iter().map(|part| part.child);
        if let Some(child) = uniform_children(children()) {
            return Part { code, child, total: 0, records: Vec::new(), tally };
        }
        let layout = RecordLayout::new(parts[0].form());
        let mut states = 0;
        let mut tallied = [0; 3];
        let mut values = Vec::with_capacity(layout.children() * layout.width);
        for (i, child) in children().enumerate() {
            let state = child.state();
            // What is below a node may not be needed here.
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
        // Invariant: what is merged of parts is a plain record, whatever its children are. So the levels
        // between a segment's node and the next candidates, whose nodes may own segments, are no part of a
        // dense block: reading turns to these segments record by record, and would find none below a block.
        layout.write(&mut records, &values, RecordHead { states, skip, dense: 0 });
        parts.iter().for_each(|part| records.extend_from_slice(&part.records));
        let cells = code.dimension().cells(depth - code.level());
        let representative = representative_of(rule, children(), &tally, cells);
        tally.keep_listed_for(rule);
        Part {
            code,
            child: Child::Inner { representative, node: () },
            // Invariant: a node's total is no less than that of a child (those of files may lie, and so do
            // not wrap round). So candidates above a heavy one are heavy, too. Looking for a node's segment
            // goes from a segment's level to the next one up because of that, and what is left of a sealed
            // part goes into a segment that reaches no deeper than it does.
            total: parts.iter().fold(1, |sum, part| sum.saturating_add(part.total)),
            records,
            tally,
        }
    }

    /// Takes the node's own segment off, if it owns one; what is left is what the next coarser segments need.
    ///
    /// # Errors
    /// If the records contradict each other, as those of parts from a file may.
    pub(in crate::store) fn seal(&mut self, shape: &Shape) -> Result<Option<SealedSegment>, BadSkip> {
        let mut is_bad = false;
        let sealed = self.seal_with(shape, |part, levels| {
            let upper = upper_levels(part.form(), &part.records, levels);
            is_bad = upper.is_err();
            upper.unwrap_or_default()
        });
        if is_bad { Err(BadSkip) } else { Ok(sealed) }
    }

    /// [`Part::seal`], given what makes records of the first levels of the node.
    pub(super) fn seal_with(
        &mut self,
        shape: &Shape,
        upper_levels: impl FnOnce(&Part, u8) -> Vec<u8>,
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
            // Invariant: no segment above reaches deeper into this node than the next one does, since all
            // reach equally far from where they begin. So records below that level are not needed any more,
            // and those above it are all there when the next segments are sealed. With fewer, these would
            // lack nodes that are in no other.
            let cut = shape.cut_level(shape.parent_segment_level(level));
            upper_levels(self, cut.saturating_sub(level))
        };
        let records = std::mem::replace(&mut self.records, above);
        Some(SealedSegment { code: self.code, records, tally: self.tally.clone(), packed: None })
    }
}

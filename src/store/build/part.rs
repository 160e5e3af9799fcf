//! Parts of a tree on their way up: merged four (or eight) by four, sealed into segments.

use super::counts::LevelCounts;
use crate::space::Code;
use crate::store::goblin::Shape;
use crate::store::goblin::{CUT, INNER, LEAF, Layout, Record, VOID};
use crate::tree::Child;
use crate::value::{Rule, Tally, Value, representative};

/// A number of records that makes a node heavy in a file of any shape.
pub(in crate::store) const ENOUGH: u64 = u32::MAX as u64;

/// A node and what coarser segments still need of the tree below it.
pub(in crate::store) struct Part<D: Layout, V: Value> {
    pub(in crate::store) code: Code<D>,
    pub(in crate::store) child: Child<V, ()>,
    /// Records of the whole subtree, written and forgotten ones included; [`ENOUGH`] or more where nobody counted.
    pub(in crate::store) total: u64,
    /// Records in preorder: all of them, or those above a cut.
    pub(in crate::store) records: Vec<D::Record<V>>,
    pub(in crate::store) tally: Tally<V>,
}

/// A segment ready to be written.
pub(in crate::store) struct Sealed<D: Layout, V: Value> {
    pub(in crate::store) code: Code<D>,
    pub(in crate::store) records: Vec<D::Record<V>>,
    pub(in crate::store) tally: Tally<V>,
}

impl<D: Layout, V: Value> Part<D, V> {
    /// A block of one value, or VOID.
    pub(in crate::store) fn uniform(code: Code<D>, depth: u8, value: Option<V>, count_classes: bool) -> Self {
        let cells = 1u64 << (D::AXES * (depth - code.level()) as usize);
        let (child, tally) = match value {
            None => (Child::Void, Tally::void()),
            Some(value) => (Child::Leaf(value), Tally::leaf(value, cells, count_classes)),
        };
        Part { code, child, total: 0, records: Vec::new(), tally }
    }

    /// The parent of these parts, which are all its children in order.
    pub(in crate::store) fn merge(
        code: Code<D>,
        parts: &[Part<D, V>],
        depth: u8,
        rule: Rule,
        counts: &mut LevelCounts,
    ) -> Self {
        let tally = Tally::merge(&parts.iter().map(|part| &part.tally).collect::<Vec<_>>());
        let first = parts[0].child;
        let uniform = parts.iter().all(|part| match (first, part.child) {
            (Child::Void, Child::Void) => true,
            (Child::Leaf(a), Child::Leaf(b)) => a.same(b),
            _ => false,
        });
        if uniform {
            return Part { code, child: first, total: 0, records: Vec::new(), tally };
        }
        let values: Vec<Option<(V, bool)>> =
            parts.iter().map(|part| part.child.value().map(|value| (value, part.child.is_inner()))).collect();
        let mut states = 0;
        let mut tallied = [0; 3];
        for (i, part) in parts.iter().enumerate() {
            let state = match part.child {
                Child::Void => VOID,
                Child::Leaf(_) => LEAF,
                Child::Inner { .. } => INNER,
            };
            states |= (state as u32) << (2 * i);
            tallied[state as usize] += 1;
        }
        counts.add(code.level() + 1, tallied);
        let stored = 1 + parts.iter().map(|part| part.records.len()).sum::<usize>();
        let mut records = Vec::with_capacity(stored);
        let value = |i: usize| values[i].map_or(V::default(), |(value, _)| value);
        records.push(D::Record::<V>::new(states, value, stored as u32));
        parts.iter().for_each(|part| records.extend_from_slice(&part.records));
        let cells = 1 << (D::AXES * (depth - code.level()) as usize);
        let representative = representative(rule, &values, &tally, cells);
        Part {
            code,
            child: Child::Inner { representative, node: () },
            total: 1 + parts.iter().map(|part| part.total).sum::<u64>(),
            records,
            tally,
        }
    }

    /// Takes the node's own segment off, if it owns one; what is left is what the next coarser segments need.
    pub(in crate::store) fn seal(&mut self, shape: &Shape) -> Option<Sealed<D, V>> {
        let level = self.code.level();
        let is_root = level == 0;
        let heavy = shape.is_candidate(level) && self.total > shape.light as u64;
        if !self.child.is_inner() || !(is_root || heavy) {
            return None;
        }
        let mut above = Vec::new();
        if !is_root {
            let cut = shape.cut_level(shape.parent_segment_level(level));
            trim::<D, V>(&self.records, 0, cut.saturating_sub(level), &mut above);
        }
        let records = std::mem::replace(&mut self.records, above);
        Some(Sealed { code: self.code, records, tally: self.tally.clone() })
    }
}

/// Copies the records of `levels` levels of the subtree at `place`; what lies deeper is CUT.
pub(in crate::store) fn trim<D: Layout, V: Value>(
    records: &[D::Record<V>],
    place: usize,
    levels: u8,
    above: &mut Vec<D::Record<V>>,
) {
    let start = above.len();
    let mut record = records[place];
    let mut states = record.states();
    above.push(record);
    let mut next = place + 1;
    for i in 0..D::CHILDREN {
        // (Records of a file may lie.)
        if let (INNER, Some(child)) = (record.state(i), records.get(next)) {
            if levels > 1 {
                trim::<D, V>(records, next, levels - 1, above);
            } else {
                states |= (CUT as u32) << (2 * i);
            }
            next += child.skip() as usize;
        }
    }
    record.set_states(states);
    record.set_skip((above.len() - start) as u32);
    above[start] = record;
}

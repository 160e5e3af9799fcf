//! Nodes of a run of records: what is below a node as it stands in a segment, records and dense blocks.

use zerocopy::IntoBytes;

use super::record::{Record, child_record, with_record_type};
use spinney_base::space::{Code, Dimension};
use spinney_base::value::Value;
use spinney_container::{CUT, DenseBlock, INNER, LEAF, RecordLayout, VOID, dense_levels};

/// An INNER node of a run: one with a record of its own, or one in a dense block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct RunNode {
    /// The number of its record, or of the block's.
    pub record: u32,
    /// Levels below the block's root; 0 for a record of its own.
    pub below: u8,
    /// Its index among the block's nodes of that level. Invariant: it has 16 bits, since dense blocks have
    /// 256 x 256 values at most, or 16 x 16 x 16.
    pub index: u16,
}

const _: () =
    assert!(2 * *dense_levels(Dimension::Quad).end() <= 16 && 3 * *dense_levels(Dimension::Oct).end() <= 16);

impl RunNode {
    /// The node with a record of its own.
    #[inline]
    pub(crate) fn of_record(record: usize) -> RunNode {
        RunNode { record: record as u32, below: 0, index: 0 }
    }
}

/// A child of a node of a run: its state, its value (zeros if it is VOID), and what it is itself if it is INNER.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RunChild {
    pub state: u8,
    pub value: Value,
    pub node: RunNode,
}

/// The children of a node, in child order; a quadtree's last four entries are not used.
pub(crate) type RunChildren = [RunChild; 8];

/// Runs of records, as their layout tells of them.
pub(crate) trait Runs {
    /// Writes the children of a node of a run; `None` if the run contradicts itself there.
    ///
    /// The node's own extent must have been checked, as those of children are here: to lie inside it and beside each other, so
    /// that no walk can leave the segment or go round in it.
    fn run_children(&self, records: &[u8], node: RunNode, children: &mut RunChildren) -> Option<()>;

    /// The dense block that a node is the root of.
    fn dense_at<'r>(&self, records: &'r [u8], node: RunNode) -> Option<DenseBlock<'r>>;

    /// The value of a node below the one at `level` whose record has a number, which is the parent's or a dense block that has
    /// it; `None` if that is no such block.
    fn value_below(&self, records: &[u8], at: usize, level: u8, code: Code) -> Option<Option<Value>>;
}

impl Runs for RecordLayout {
    #[inline]
    fn run_children(&self, records: &[u8], node: RunNode, children: &mut RunChildren) -> Option<()> {
        let at = node.record as usize;
        let head = self.head(records, at)?;
        if head.dense != 0 {
            return dense_children(&self.dense(records, at, head)?, node, children);
        }
        // (A node of a block that is none.)
        if node.below > 0 {
            return None;
        }
        // Invariant: the extent of the node was checked by whoever leads to it, the root's when its run was
        // loaded; those of children are checked here to lie in it, one behind the other. So no walk leaves
        // the run or goes round in it, and each record belongs to one node: what a walk takes is bounded by
        // the records, whatever they say.
        let end = at + head.skip as usize;
        let mut next = at + 1;
        for (step, child) in children[..self.children()].iter_mut().enumerate() {
            let state = head.state(step);
            *child = RunChild { state, value: Value::ZERO, node: RunNode::default() };
            if state != VOID {
                child.value = self.value(records, at, step);
            }
            if state == INNER {
                let skip = if next < end { self.head(records, next)?.skip as usize } else { 0 };
                if skip == 0 || next + skip > end {
                    return None;
                }
                child.node = RunNode::of_record(next);
                next += skip;
            }
        }
        Some(())
    }

    #[inline]
    fn dense_at<'r>(&self, records: &'r [u8], node: RunNode) -> Option<DenseBlock<'r>> {
        let at = node.record as usize;
        let head = self.head(records, at).filter(|head| head.dense != 0 && node.below == 0)?;
        self.dense(records, at, head)
    }

    fn value_below(&self, records: &[u8], at: usize, level: u8, code: Code) -> Option<Option<Value>> {
        let head = self.head(records, at)?;
        let levels = code.level() - level;
        if levels == 1 {
            let step = code.step(level);
            return Some((head.state(step) != VOID).then(|| self.value(records, at, step)));
        }
        let block = self.dense(records, at, head).filter(|block| block.levels >= levels)?;
        Some(block.value_at(levels, code.cell()))
    }
}

/// End of a descent through the records of one run.
pub(crate) enum Descent {
    /// In a VOID block.
    Void,
    /// In a block of one value.
    Leaf(Value),
    /// At the node itself, whose record has this number.
    Inner(usize),
    /// At the record with this number, of the node's ancestor at a level, which is a dense block.
    Dense(usize, u8),
    /// At a level whose node has its record in another run.
    Cut(u8),
    /// At the record with this number, whose skip leads out of the node.
    BadSkip(usize),
}

/// A way down, from the record of a node's ancestor at a level to the node.
pub(crate) type Descend = fn(records: &[u8], at: usize, level: u8, code: Code) -> Descent;

/// The way down through records of a layout, which is half of what the answer for a point costs.
pub(in crate::store) fn descend_in(layout: RecordLayout) -> Descend {
    with_record_type!(layout, R => descend::<R>)
}

/// Goes down from the record of a node's ancestor at `level` to the node's own.
fn descend<R: Record>(records: &[u8], mut at: usize, level: u8, code: Code) -> Descent {
    let records = R::of(records);
    for level in level..code.level() {
        let Some(record) = records.get(at) else { return Descent::BadSkip(at) };
        let step = code.step(level);
        match record.state(step) {
            VOID => return Descent::Void,
            LEAF => return Descent::Leaf(Value::from_bytes(record.values()[step].as_bytes())),
            CUT => return Descent::Cut(level + 1),
            _ => {}
        }
        if record.is_dense() {
            return Descent::Dense(at, level);
        }
        match child_record(records, at, step) {
            Some(child) => at = child,
            None => return Descent::BadSkip(at),
        }
    }
    Descent::Inner(at)
}

/// The children of a node of a dense block; `None` for one at its bottom, or below.
fn dense_children(block: &DenseBlock<'_>, node: RunNode, children: &mut RunChildren) -> Option<()> {
    let level = node.below + 1;
    if level > block.levels {
        return None;
    }
    for (step, child) in children[..block.children()].iter_mut().enumerate() {
        let index = block.child(level, usize::from(node.index), step);
        let state = block.state(level, index);
        let value = if state == VOID { Value::ZERO } else { block.value(level, index) };
        debug_assert!(matches!(state, LEAF | INNER | CUT | VOID));
        *child = RunChild { state, value, node: RunNode { below: level, index: index as u16, ..node } };
    }
    Some(())
}

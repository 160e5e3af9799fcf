//! Nodes of a run of records: the subtree of a node as stored in a segment, in records and dense
//! blocks.

use zerocopy::IntoBytes;

use super::record::{Record, child_record, with_record_type};
use spinney_base::space::{Code, Dimension};
use spinney_base::value::Value;
use spinney_container::{CUT, DenseBlock, INNER, LEAF, RecordLayout, VOID, dense_levels};

/// An INNER node of a run: one with a record of its own, or one in a dense block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct RunNode {
    /// Index of its record, or of the block's.
    pub record: u32,
    /// Levels below the block's root; 0 for a record of its own.
    pub below: u8,
    /// Its index among the block's nodes of that level. Invariant: the index fits into 16 bits,
    /// since dense blocks have at most 256 x 256 values, or 16 x 16 x 16.
    pub index: u16,
}

const _: () =
    assert!(2 * *dense_levels(Dimension::Quad).end() <= 16 && 3 * *dense_levels(Dimension::Oct).end() <= 16);

impl RunNode {
    /// Returns the node with a record of its own.
    #[inline]
    pub(crate) fn of_record(record: usize) -> RunNode {
        RunNode { record: record as u32, below: 0, index: 0 }
    }
}

/// A child of a node of a run: its state, its value (zeros if it is VOID), and its node if it is
/// INNER.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RunChild {
    pub state: u8,
    pub value: Value,
    pub node: RunNode,
}

/// The children of a node, in child order; a quadtree does not use the last four entries.
pub(crate) type RunChildren = [RunChild; 8];

/// Access to runs of records by their layout.
pub(crate) trait Runs {
    /// Writes the children of a node of a run to `children`; returns `None` if the records there
    /// are inconsistent.
    ///
    /// The node's own extent must have been checked. This checks the children's extents: they must
    /// lie inside it and not overlap, so that no traversal can leave the segment or loop in it.
    fn run_children(&self, records: &[u8], node: RunNode, children: &mut RunChildren) -> Option<()>;

    /// Returns the dense block that has a node as its root.
    fn dense_at<'r>(&self, records: &'r [u8], node: RunNode) -> Option<DenseBlock<'r>>;

    /// Returns the value of the node `code`. Record `at` is that of its ancestor at `level`: the
    /// parent, or a dense block that contains the node. `None` if it is not such a block.
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
        // (The node claims to be in a dense block, but the record is not one.)
        if node.below > 0 {
            return None;
        }
        // Invariant: the node's extent was checked by the caller that found the node, and the
        // root's when its run was loaded. The children's extents are checked here: consecutive and
        // inside the node. So no traversal leaves the run or loops in it, and each record belongs
        // to one node. The number of records bounds the cost of a traversal, whatever their
        // contents.
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

/// Result of a descent through the records of one run.
pub(crate) enum Descent {
    /// In a VOID block.
    Void,
    /// In a block of one value.
    Leaf(Value),
    /// At the node itself, whose record has this index.
    Inner(usize),
    /// At a dense block: index of its record, and level of the node's ancestor that is its root.
    Dense(usize, u8),
    /// At this level, where the node's ancestor has its record in another run.
    Cut(u8),
    /// At the record with this index, whose skip leads out of the node.
    BadSkip(usize),
}

/// Descends to the node `code`, from record `at` of its ancestor at `level`.
pub(crate) type Descend = fn(records: &[u8], at: usize, level: u8, code: Code) -> Descent;

/// Returns the descent through records of a layout. It takes half of the time of a point query.
pub(in crate::store) fn descend_in(layout: RecordLayout) -> Descend {
    with_record_type!(layout, R => descend::<R>)
}

/// Descends from the record of a node's ancestor at `level` to the node's own record.
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

/// Returns the children of a node of a dense block; `None` for a node at its bottom, or below.
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

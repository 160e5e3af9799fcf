//! Merging of two trees: actions at pairs of nodes, and operations that join values.

use super::stored_node::StoredNode;
use crate::tree::{Child, NodeState};
use spinney_base::SetOperation;
use spinney_base::value::{Native, Value, ValueType, erase, native, with_native_type};

/// Action at a pair of nodes when two trees are merged into one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MergeAction {
    /// VOID.
    Void,
    /// The node of this tree, with its subtree.
    Keep(usize),
    /// A fill value that neither tree has.
    Fill,
    /// A LEAF with the joined values of two uniform nodes, or VOID: see [`Join`].
    Join,
    /// An INNER node, whose children are merged recursively.
    Split,
}

/// Operation that joins the values of two uniform nodes into one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Join {
    /// The smaller sample of each channel.
    Min,
    /// The larger sample of each channel.
    Max,
    /// The sum per channel, saturating at the limits of the type.
    Add,
    /// The difference per channel, saturating at the limits of the type.
    Subtract,
    /// The value, if both are equal; else VOID.
    Equal,
    /// The second value, if it differs from the first; else VOID.
    Changed,
    /// The set operation on coverages in bytes, where VOID is 0: see [`joined_coverage`].
    Coverage(SetOperation),
}

/// Full coverage.
pub const FULL_COVERAGE: u8 = u8::MAX;

/// Returns a cell's coverage by the result of a set operation on two bodies, from the coverages by
/// the two: the sum of the minterms (both, only the first, only the second, neither) that the bits
/// of its [index](SetOperation::index) select.
///
/// The bodies are assumed to overlap as much as possible. Only this assumption makes a body minus
/// itself empty. For any overlap, the coverage by both and the coverages by each alone are
/// consistent with the two inputs.
pub fn joined_coverage(operation: SetOperation, a: u8, b: u8) -> u8 {
    let both = a.min(b);
    let minterms = [both, a - both, b - both, FULL_COVERAGE - a.max(b)];
    // Invariant: the four minterms add up to full coverage for any inputs: with maximum overlap,
    // both and each alone sum up to the larger input. So no sum exceeds a byte, and an operation
    // and its complement add up to full coverage. If one of the minterms assumed another overlap,
    // sums would wrap around.
    let index = operation.index();
    (0..4).filter(|bit| index >> bit & 1 != 0).map(|bit| minterms[bit]).sum()
}

impl Join {
    /// Joins two values; `None` is VOID. A computed sample is missing if one of its operands is.
    pub fn values(self, value_type: ValueType, a: Value, b: Value) -> Option<Value> {
        match self {
            Join::Coverage(operation) => {
                let (mut bytes, other) = (a.to_bytes(), b.to_bytes());
                let is_there = join_coverages(operation, &mut bytes[..value_type.size()], &other);
                is_there.then(|| Value::from_bytes(&bytes[..value_type.size()]))
            }
            _ => self.samples(value_type, a, b),
        }
    }

    /// Joins two values that are not coverages.
    fn samples(self, value_type: ValueType, a: Value, b: Value) -> Option<Value> {
        let joined = with_native_type!(value_type, V => self.native::<V>(native(a), native(b)).map(erase))?;
        let missing = value_type.all_missing().filter(|_| self.computes_samples());
        let Some(missing) = missing else { return Some(joined) };
        let (in_a, in_b) = (value_type.present(a), value_type.present(b));
        let is_there = |channel: usize| in_a[channel] && in_b[channel];
        let any = (0..usize::from(value_type.channels)).any(is_there);
        any.then(|| value_type.by_channel(|channel| if is_there(channel) { joined } else { missing }))
    }

    /// Returns whether values are computed sample by sample, instead of copied as a whole.
    pub(crate) fn computes_samples(self) -> bool {
        matches!(self, Join::Min | Join::Max | Join::Add | Join::Subtract)
    }

    /// Joins two values of known type; `None` is VOID.
    #[inline]
    pub(super) fn native<V: Native>(self, a: V, b: V) -> Option<V> {
        match self {
            Join::Coverage(_) => unreachable!("coverages are joined as bytes"),
            Join::Min => Some(a.min(b)),
            Join::Max => Some(a.max(b)),
            Join::Add => Some(a.plus(b)),
            Join::Subtract => Some(a.minus(b)),
            Join::Equal => a.same(b).then_some(a),
            Join::Changed => (!a.same(b)).then_some(b),
        }
    }
}

/// Joins coverages channel by channel into the first; returns whether any coverage is left.
#[inline]
pub(super) fn join_coverages(operation: SetOperation, coverages: &mut [u8], others: &[u8]) -> bool {
    for (a, b) in coverages.iter_mut().zip(others) {
        *a = joined_coverage(operation, *a, *b);
    }
    coverages.iter().any(|coverage| *coverage != 0)
}

/// State of a node as distinguished by merge actions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MergeState {
    /// No data.
    Void = 0,
    /// One value throughout; full, where coverages are merged.
    Leaf = 1,
    /// More detail below.
    Inner = 2,
    /// A LEAF of any other coverage.
    Partial = 3,
}

impl From<NodeState> for MergeState {
    #[inline]
    fn from(state: NodeState) -> MergeState {
        match state {
            NodeState::Void => MergeState::Void,
            NodeState::Leaf => MergeState::Leaf,
            NodeState::Inner => MergeState::Inner,
        }
    }
}

/// Merge actions by the states of the two trees at a node.
#[derive(Clone, Copy, Debug)]
pub struct MergeTable([[MergeAction; 4]; 4]);

impl MergeTable {
    /// Returns the table of an action; calls `action` once for each pair of states.
    pub fn new(action: impl Fn([MergeState; 2]) -> MergeAction) -> MergeTable {
        const STATES: [MergeState; 4] =
            [MergeState::Void, MergeState::Leaf, MergeState::Inner, MergeState::Partial];
        MergeTable(STATES.map(|first| STATES.map(|second| action([first, second]))))
    }

    /// Returns the action for a pair of states.
    #[inline]
    pub fn get(&self, [first, second]: [MergeState; 2]) -> MergeAction {
        self.0[first as usize][second as usize]
    }
}

/// How two trees are merged into one.
#[derive(Clone, Copy, Debug)]
pub struct Merging {
    /// Actions by the states of the trees' nodes.
    pub(crate) actions: MergeTable,
    /// Operation on values, for actions that join them.
    pub join: Join,
    /// The value of full LEAFs, where coverages are merged: see [`MergeState::Partial`].
    pub full: Option<Value>,
}

impl Merging {
    /// Returns the action for a pair of nodes.
    #[inline]
    pub fn action<N>(&self, nodes: [&Child<N>; 2]) -> MergeAction {
        self.actions.get(nodes.map(|node| match node {
            Child::Leaf(value) if self.full.is_some_and(|full| full != *value) => MergeState::Partial,
            _ => node.state().into(),
        }))
    }
}

/// A node of two stored trees that are merged into one, cell by cell, with its subtree.
#[derive(Clone, Copy)]
pub struct Overlay<'a> {
    /// The node of each of the two trees.
    pub nodes: [Child<StoredNode<'a>>; 2],
    /// How they are merged.
    pub(crate) merging: Merging,
}

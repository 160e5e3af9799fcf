//! Tables of node kinds: what a set operation does with a pair of nodes of two octrees.
//!
//! Source: P. Slavik's set operations on extended octrees. Both trees are traversed together, and
//! each operation has a table of 6 x 6 entries, one for each pair of node kinds. Here, a seventh
//! kind is for leaves whose planes have no common point. Entries are not listed: `entry` derives
//! them from the operation, for any number of operands, and `combine` takes its decisions from it.

use super::table::{Fate, OperationTable};
use crate::store::NodeKind;
use crate::{ModelNode, ModelNodeState};
use spinney_base::SetOperation;

/// Kind of an operand's node in the tables of set operations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum OperandKind {
    /// Outside of the body.
    Void,
    /// Inside of the body.
    Full,
    /// Divided into eight children; also several nodes near one node of the other tree, if any of
    /// them is not uniform.
    Mixed,
    /// A leaf with faces in one plane.
    Face,
    /// A leaf whose planes share a line.
    Edge,
    /// A leaf whose planes share a point.
    Vertex,
    /// Any other leaf: its planes share nothing, or only faces with vertices off the grid are near
    /// its cell. The table of the literature has no such kind. It divides these cells further.
    Boolean,
}

impl OperandKind {
    /// All kinds, in the order of the table.
    pub const ALL: [OperandKind; 7] = [
        OperandKind::Void,
        OperandKind::Full,
        OperandKind::Mixed,
        OperandKind::Face,
        OperandKind::Edge,
        OperandKind::Vertex,
        OperandKind::Boolean,
    ];

    /// Returns the kind of a node. Only nodes whose winding number is certain are uniform.
    pub(super) fn of(node: &ModelNode<'_>) -> OperandKind {
        match (node.winding(), node.state()) {
            (Some(winding), _) => OperandKind::uniform(winding > 0),
            (None, ModelNodeState::Inner) => OperandKind::Mixed,
            (None, ModelNodeState::Leaf { kind: NodeKind::Face, .. }) => OperandKind::Face,
            (None, ModelNodeState::Leaf { kind: NodeKind::Edge, .. }) => OperandKind::Edge,
            (None, ModelNodeState::Leaf { kind: NodeKind::Vertex, .. }) => OperandKind::Vertex,
            (None, _) => OperandKind::Boolean,
        }
    }

    /// Returns the kind of a uniform node.
    pub(super) fn uniform(is_full: bool) -> OperandKind {
        if is_full { OperandKind::Full } else { OperandKind::Void }
    }

    /// Whether all points of the node are in the body, or none of them.
    pub(super) fn is_uniform(self) -> bool {
        matches!(self, OperandKind::Void | OperandKind::Full)
    }
}

/// Entry of the table of a set operation: the result in the cell of a pair of nodes. Operands have
/// numbers, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableEntry {
    /// The result is VOID.
    Void,
    /// The result is FULL.
    Full,
    /// The result is a copy of an operand's subtree.
    Copy(usize),
    /// The result is the complement of an operand's subtree: its faces are reversed.
    Complement(usize),
    /// The nodes are divided, and their children decide.
    Divide,
    /// The result is a polyhedron that is computed face by face.
    Faces,
}

impl TableEntry {
    /// Returns the fate of all faces of operand `own` in the cell; `None` if the entry does not
    /// decide.
    pub(super) fn fate(self, own: usize) -> Option<Fate> {
        match self {
            TableEntry::Divide | TableEntry::Faces => None,
            TableEntry::Copy(operand) if operand == own => Some(Fate::Keep),
            TableEntry::Complement(operand) if operand == own => Some(Fate::Reverse),
            _ => Some(Fate::Drop),
        }
    }
}

impl OperationTable {
    /// Returns the entry for one node of each operand.
    pub(super) fn entry(self, nodes: &[OperandKind]) -> TableEntry {
        let mut open = (0..nodes.len()).filter(|body| !nodes[*body].is_uniform() && self.depends_on(*body));
        let is_inside = |others: bool| {
            self.includes(|body| match nodes.get(body) {
                Some(OperandKind::Full) => true,
                Some(OperandKind::Void) | None => false,
                Some(_) => others,
            })
        };
        match (open.next(), open.next()) {
            (None, _) if is_inside(false) => TableEntry::Full,
            (None, _) => TableEntry::Void,
            (Some(body), None) => match [false, true].map(is_inside) {
                [false, false] => TableEntry::Void,
                [false, true] => TableEntry::Copy(body),
                [true, false] => TableEntry::Complement(body),
                [true, true] => TableEntry::Full,
            },
            (Some(first), Some(second)) => {
                match [first, second].into_iter().chain(open).any(|body| nodes[body] == OperandKind::Mixed) {
                    true => TableEntry::Divide,
                    false => TableEntry::Faces,
                }
            }
        }
    }
}

/// A pair of node kinds in the table of a set operation on two models.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct NodePair {
    /// Kinds of the first and of the second model's node.
    pub kinds: [OperandKind; 2],
    /// Entry of the operation's table for such nodes.
    pub entry: TableEntry,
    /// How often the traversal for the first model's faces met the pair, and how often that for the
    /// second model's faces. Each traversal visits nodes of its own model. It compares each with
    /// the other model's nodes within a grid unit of its cell.
    pub met: [u64; 2],
}

/// Number of kinds.
const KINDS: usize = OperandKind::ALL.len();

/// How often each pair of node kinds was met, per traversal.
#[derive(Clone, Debug, Default)]
pub(super) struct PairCounts([[[u64; KINDS]; KINDS]; 2]);

impl PairCounts {
    /// Counts a pair that the traversal for the faces of model `own` met.
    pub(super) fn add(&mut self, own: usize, kinds: [OperandKind; 2]) {
        let [first, second] = kinds.map(|kind| kind as usize);
        self.0[own][first][second] += 1;
    }
}

/// Returns the table of an operation on two models: a line for each pair of kinds, with its counts.
pub(super) fn node_pairs(operation: SetOperation, counts: &PairCounts) -> Vec<NodePair> {
    let table = OperationTable::of_two(operation);
    let pairs = OperandKind::ALL.into_iter().flat_map(|a| OperandKind::ALL.map(|b| [a, b]));
    let with_counts = |kinds: [OperandKind; 2]| {
        let [first, second] = kinds.map(|kind| kind as usize);
        NodePair {
            kinds,
            entry: table.entry(&kinds),
            met: [0, 1].map(|own: usize| counts.0[own][first][second]),
        }
    };
    pairs.map(with_counts).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A node as a naive model: whether points in its cell can be outside, and inside.
    fn states(kind: OperandKind) -> &'static [bool] {
        match kind {
            OperandKind::Void => &[false],
            OperandKind::Full => &[true],
            _ => &[false, true],
        }
    }

    /// Each entry of all sixteen tables gives the result for all points that such nodes can have,
    /// and is the simplest one that does.
    #[test]
    fn entries_are_right_for_all_points_and_as_simple_as_possible() {
        type Rule = fn(bool, bool) -> bool;
        let rules: [(TableEntry, Rule); 6] = [
            (TableEntry::Void, |_, _| false),
            (TableEntry::Full, |_, _| true),
            (TableEntry::Copy(0), |a, _| a),
            (TableEntry::Copy(1), |_, b| b),
            (TableEntry::Complement(0), |a, _| !a),
            (TableEntry::Complement(1), |_, b| !b),
        ];
        for operation in SetOperation::ALL {
            let pairs = node_pairs(operation, &PairCounts::default());
            assert_eq!(pairs.len(), 49);
            for NodePair { kinds: [a, b], entry, .. } in pairs {
                let is_right = |rule: &Rule| {
                    let points =
                        states(a).iter().flat_map(|in_a| states(b).iter().map(move |in_b| (*in_a, *in_b)));
                    points.into_iter().all(|(in_a, in_b)| {
                        rule(in_a, in_b)
                            == ((operation.index() >> (2 * u8::from(!in_a) + u8::from(!in_b))) & 1 == 1)
                    })
                };
                let simplest = rules.iter().find(|(_, rule)| is_right(rule)).map(|(entry, _)| *entry);
                let is_mixed = a == OperandKind::Mixed || b == OperandKind::Mixed;
                let expected =
                    simplest.unwrap_or(if is_mixed { TableEntry::Divide } else { TableEntry::Faces });
                assert_eq!(entry, expected, "{operation}: {a:?} and {b:?}");
            }
        }
    }

    /// The rows that P. Slavik describes: in the intersection, row V is all V, and row F copies B.
    #[test]
    fn rows_of_the_intersection_are_those_of_the_literature() {
        use OperandKind::{Face, Full, Mixed, Void};
        let table = OperationTable::of_two(SetOperation::Intersection);
        for kind in OperandKind::ALL {
            assert_eq!(table.entry(&[Void, kind]), TableEntry::Void);
            assert_eq!(table.entry(&[kind, Void]), TableEntry::Void);
            if !kind.is_uniform() {
                assert_eq!(table.entry(&[Full, kind]), TableEntry::Copy(1));
                assert_eq!(table.entry(&[kind, Full]), TableEntry::Copy(0));
                assert_eq!(table.entry(&[Mixed, kind]), TableEntry::Divide);
            }
            if !kind.is_uniform() && kind != Mixed {
                assert_eq!(table.entry(&[Face, kind]), TableEntry::Faces);
            }
        }
        assert_eq!(table.entry(&[Full, Full]), TableEntry::Full);
    }

    /// With more operands, an entry decides as soon as all nodes but one are uniform.
    #[test]
    fn entries_of_many_operands() {
        use OperandKind::{Edge, Face, Full, Mixed, Void};
        let of = |operation, nodes: &[OperandKind]| {
            OperationTable::new(operation, nodes.len()).unwrap().entry(nodes)
        };
        assert_eq!(of(SetOperation::Union, &[Void, Face, Void]), TableEntry::Copy(1));
        assert_eq!(of(SetOperation::Union, &[Full, Face, Void]), TableEntry::Full);
        assert_eq!(of(SetOperation::Difference, &[Full, Void, Edge]), TableEntry::Complement(2));
        assert_eq!(of(SetOperation::SymmetricDifference, &[Full, Full, Mixed]), TableEntry::Copy(2));
        assert_eq!(of(SetOperation::NotBoth, &[Full, Full, Face]), TableEntry::Complement(2));
        assert_eq!(of(SetOperation::Union, &[Void, Face, Edge]), TableEntry::Faces);
        assert_eq!(of(SetOperation::Union, &[Mixed, Face, Edge]), TableEntry::Divide);
    }

    /// Models that are only divided along each other's surface depend on both operands.
    #[test]
    fn cuts_depend_on_both_operands() {
        use OperandKind::{Face, Void};
        let table = OperationTable::of_two(SetOperation::First);
        assert_eq!(table.entry(&[Face, Face]), TableEntry::Copy(0));
        assert_eq!(table.keeping_cuts().entry(&[Face, Face]), TableEntry::Faces);
        assert_eq!(table.keeping_cuts().entry(&[Face, Void]), TableEntry::Copy(0));
        assert_eq!(table.keeping_cuts().entry(&[Void, Face]).fate(1), Some(Fate::Drop));
    }
}

//! The nodes of one level of a block.

use zerocopy::FromBytes;

use super::reused::ReusedNode;
use crate::store::records::Record;
use spinney_base::TreeType;
use spinney_base::value::Value;
use spinney_container::{INNER, LEAF, VOID};

/// The nodes of one level that were looked at, in Z order: the children of all expanded nodes of the level
/// above.
pub(super) struct Level {
    pub(super) states: Vec<u8>,
    /// The values' bytes. Invariant: zeros where a node is VOID. Levels begin as zeros, and whoever makes a
    /// node a LEAF writes its value. So bytes of files do not depend on what nobody sees; uniform VOID
    /// children make a VOID parent of the same bytes; and who draws dense blocks need not ask for the state
    /// of a value that is not zero.
    pub(super) values: Vec<u8>,
    /// Indices, in this level, of the nodes whose children make up the next one; `None`: all of them.
    pub(super) expanded: Option<Vec<u32>>,
    /// INNER nodes that came as a whole. Invariant: ascending, as those that were expanded are, since nodes
    /// are gone through in Z order. Groups of children in the next level are told by this order, and records
    /// are found by it: with another, nodes would get the children of others.
    pub(super) reused: Vec<ReusedNode>,
}

impl Level {
    /// A level of so many VOID nodes.
    pub(super) fn new(form: TreeType, nodes: usize) -> Level {
        Level {
            states: vec![VOID; nodes],
            values: vec![0; nodes * form.width()],
            expanded: None,
            reused: Vec::new(),
        }
    }

    /// The level of a block's root, which is INNER as far as is known.
    pub(super) fn root(form: TreeType) -> Level {
        Level { expanded: Some(vec![0]), ..Level::new(form, 1) }
    }

    /// The values, with their width known at compile time.
    #[inline]
    pub(super) fn values_of<R: Record>(&self) -> &[R::Bytes] {
        <[R::Bytes]>::ref_from_bytes(&self.values).expect("whole values")
    }

    /// A node's value.
    #[inline]
    pub(super) fn value(&self, form: TreeType, index: usize) -> Value {
        Value::read(&self.values[index * form.width()..], form.width()).expect("a value per node")
    }

    /// Makes a node a LEAF.
    #[inline]
    pub(super) fn put_leaf(&mut self, form: TreeType, index: usize, value: Value) {
        // (NaN is VOID.)
        if !form.value.is_nan(value) {
            self.states[index] = LEAF;
            value.write(&mut self.values[index * form.width()..][..form.width()]);
        }
    }

    /// Makes a node one whose records are taken over.
    pub(super) fn put_reused(&mut self, form: TreeType, representative: Value, node: ReusedNode) {
        let index = node.index as usize;
        self.states[index] = INNER;
        representative.write(&mut self.values[index * form.width()..][..form.width()]);
        self.reused.push(node);
    }

    /// The index of the node whose children are the `group`-th group of the next level.
    #[inline]
    pub(super) fn parent(&self, group: usize) -> usize {
        self.expanded.as_ref().map_or(group, |expanded| expanded[group] as usize)
    }
}

//! The nodes of one level of a block.

use zerocopy::FromBytes;

use super::reused::ReusedNode;
use crate::store::records::Record;
use spinney_base::TreeType;
use spinney_base::value::Value;
use spinney_container::{INNER, LEAF, VOID};

/// The visited nodes of one level, in Z order: the children of all expanded nodes of the level
/// above.
pub(super) struct Level {
    pub(super) states: Vec<u8>,
    /// The values' bytes. Invariant: zeros where a node is VOID. Levels are initialized with zeros,
    /// and making a node a LEAF writes its value. So the bytes of files do not depend on invisible
    /// values, uniform VOID children yield a VOID parent with the same bytes, and code that draws
    /// dense blocks does not need the state of a value that is not zero.
    pub(super) values: Vec<u8>,
    /// Indices, in this level, of the nodes whose children make up the next one; `None`: all of
    /// them.
    pub(super) expanded: Option<Vec<u32>>,
    /// INNER nodes with copied records. Invariant: ascending, like those that were expanded, since
    /// nodes are visited in Z order. This order assigns records, and groups of children in the next
    /// level, to nodes. In any other order, nodes would get the children of others.
    pub(super) reused: Vec<ReusedNode>,
}

impl Level {
    /// Returns a level of `nodes` VOID nodes.
    pub(super) fn new(form: TreeType, nodes: usize) -> Level {
        Level {
            states: vec![VOID; nodes],
            values: vec![0; nodes * form.width()],
            expanded: None,
            reused: Vec::new(),
        }
    }

    /// Returns the level of a block's root, which counts as INNER until the block is reduced.
    pub(super) fn root(form: TreeType) -> Level {
        Level { expanded: Some(vec![0]), ..Level::new(form, 1) }
    }

    /// Returns the values, with their width known at compile time.
    #[inline]
    pub(super) fn values_of<R: Record>(&self) -> &[R::Bytes] {
        <[R::Bytes]>::ref_from_bytes(&self.values).expect("whole values")
    }

    /// Returns a node's value.
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

    /// Makes a node an INNER node with copied records.
    pub(super) fn put_reused(&mut self, form: TreeType, representative: Value, node: ReusedNode) {
        let index = node.index as usize;
        self.states[index] = INNER;
        representative.write(&mut self.values[index * form.width()..][..form.width()]);
        self.reused.push(node);
    }

    /// Returns the index of the node whose children are the `group`-th group of the next level.
    #[inline]
    pub(super) fn parent(&self, group: usize) -> usize {
        self.expanded.as_ref().map_or(group, |expanded| expanded[group] as usize)
    }
}

//! Sources: all trees that can be traversed from the root down.

use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::space::Bounds;
use spinney_base::value::{Value, ZoneStats};

/// A node without its descendants: VOID, LEAF, or INNER with a representative and a handle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Child<N> {
    /// No data: outside of the extent, nodata, empty space.
    #[default]
    Void,
    /// One value throughout.
    Leaf(Value),
    /// More detail below.
    Inner {
        /// The value of the node at coarse detail.
        representative: Value,
        /// The handle by which the source finds the children.
        node: N,
    },
}

impl<N> Child<N> {
    /// Returns VOID for `None`, else a LEAF.
    #[inline]
    pub fn uniform(value: Option<Value>) -> Child<N> {
        value.map_or(Child::Void, Child::Leaf)
    }

    /// Returns the value (LEAF) or representative (INNER); `None` is VOID.
    #[inline]
    pub fn value(&self) -> Option<Value> {
        match self {
            Child::Void => None,
            Child::Leaf(value) => Some(*value),
            Child::Inner { representative, .. } => Some(*representative),
        }
    }

    /// Replaces the handle of an INNER node, for a source that has handles of another type.
    #[inline]
    pub(crate) fn map_node<M>(self, node_of: impl FnOnce(N) -> M) -> Child<M> {
        match self {
            Child::Void => Child::Void,
            Child::Leaf(value) => Child::Leaf(value),
            Child::Inner { representative, node } => Child::Inner { representative, node: node_of(node) },
        }
    }

    /// Returns the state alone, without value and handle.
    #[inline]
    pub fn state(&self) -> NodeState {
        match self {
            Child::Void => NodeState::Void,
            Child::Leaf(_) => NodeState::Leaf,
            Child::Inner { .. } => NodeState::Inner,
        }
    }

    /// Returns whether there is more detail below.
    #[inline]
    pub fn is_inner(&self) -> bool {
        matches!(self, Child::Inner { .. })
    }
}

/// State of a node; both formats store these numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeState {
    /// No data.
    Void = 0,
    /// One value throughout.
    Leaf = 1,
    /// More detail below.
    Inner = 2,
}

/// The children of a node in child order; a quadtree does not use the last four entries. The caller
/// of [`Source::children`] owns the array, so that traversals reuse its memory.
pub type Children<N> = [Child<N>; 8];

/// Returns an array for the children of a node, all VOID.
#[inline]
pub fn no_children<N>() -> Children<N> {
    [const { Child::Void }; 8]
}

/// Cells of a block in rows: x fastest, then y, then z.
#[derive(Clone, Debug, PartialEq)]
pub struct CellBlock {
    /// Whether each cell has a value; `false` is VOID.
    pub present: Vec<bool>,
    /// Bytes of the values; those of VOID cells are arbitrary.
    pub values: Vec<u8>,
}

impl CellBlock {
    /// Returns a block of VOID cells, for values of `width` bytes.
    pub fn void(cells: usize, width: usize) -> CellBlock {
        CellBlock { present: vec![false; cells], values: vec![0; cells * width] }
    }
}

/// A tree that can be traversed from the root down: a mapped file, a tree in memory, a view of
/// either.
///
/// This is the `classify` and `subdivide` scheme of the octree literature: a source classifies a
/// block as VOID, LEAF or INNER and returns its children on demand. A source need not be condensed
/// (an INNER node may turn out to be uniform), and its representatives need not be exact: code that
/// stores a tree condenses it and computes representatives again.
pub trait Source: Sync {
    /// Handle of an INNER node.
    type Node: Clone + Send + Sync;

    /// Returns the tree type: quadtree or octree, and the type of the values.
    fn form(&self) -> TreeType;

    /// Returns the number of levels below the root; nodes at this level are single cells and never
    /// INNER.
    fn depth(&self) -> u8;

    /// Returns the root, which covers the whole space.
    ///
    /// # Errors
    /// If the source fails.
    fn root(&self) -> Result<Child<Self::Node>>;

    /// Writes the children of an INNER node to the first entries, in child order.
    ///
    /// # Errors
    /// If the source fails.
    fn children(&self, node: &Self::Node, children: &mut Children<Self::Node>) -> Result<()>;

    /// Returns all cells below an INNER node that has the given number of levels below it, if the
    /// source can provide them faster than through its children.
    ///
    /// # Errors
    /// If the source fails.
    fn cells(&self, _: &Self::Node, _: u8) -> Result<Option<CellBlock>> {
        Ok(None)
    }

    /// Draws a box of cells inside the tree's space, x fastest, then y, then z: values, and which
    /// of them are not VOID. Returns whether the source supports this.
    ///
    /// # Errors
    /// If the source fails.
    fn draw(&self, _: &Bounds, _: &mut [u8], _: &mut [bool]) -> Result<bool> {
        Ok(false)
    }

    /// Checks that the file has not been changed since it was opened, so that what was read is
    /// consistent. To be called once at the end of a traversal.
    ///
    /// # Errors
    /// If it was changed.
    fn check_unchanged(&self) -> Result<()> {
        Ok(())
    }

    /// Returns the zone statistics of an INNER node, if the source has them without traversing the
    /// subtree.
    ///
    /// # Errors
    /// If the source fails.
    fn tally(&self, _: &Self::Node) -> Result<Option<ZoneStats>> {
        Ok(None)
    }
}

//! Sources: everything that can be walked from the root down.

use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::space::Bounds;
use spinney_base::value::{Value, ZoneStats};

/// A node without its descendants: VOID, LEAF, or INNER with a representative and a handle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Child<N> {
    /// Nothing: outside the data, no data, empty space.
    #[default]
    Void,
    /// One value all over.
    Leaf(Value),
    /// More detail below.
    Inner {
        /// The one value that stands for the node at coarse detail.
        representative: Value,
        /// The handle by which the source finds the children.
        node: N,
    },
}

impl<N> Child<N> {
    /// VOID, or a LEAF.
    #[inline]
    pub fn uniform(value: Option<Value>) -> Child<N> {
        value.map_or(Child::Void, Child::Leaf)
    }

    /// The value (LEAF) or representative (INNER); `None` is VOID.
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

    /// The state alone, without value and handle.
    #[inline]
    pub fn state(&self) -> NodeState {
        match self {
            Child::Void => NodeState::Void,
            Child::Leaf(_) => NodeState::Leaf,
            Child::Inner { .. } => NodeState::Inner,
        }
    }

    /// Whether there is more detail below.
    #[inline]
    pub fn is_inner(&self) -> bool {
        matches!(self, Child::Inner { .. })
    }
}

/// State of a node; the numbers are those of both formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeState {
    /// Nothing there.
    Void = 0,
    /// One value all over.
    Leaf = 1,
    /// More detail below.
    Inner = 2,
}

/// The children of a node in child order; a quadtree's last four entries are not used. The caller of
/// [`Source::children`] owns the array, so that walks reuse its memory.
pub type Children<N> = [Child<N>; 8];

/// An array for the children of a node, all VOID.
#[inline]
pub fn no_children<N>() -> Children<N> {
    [const { Child::Void }; 8]
}

/// Cells of a block in rows: x runs fastest, then y, then z.
#[derive(Clone, Debug, PartialEq)]
pub struct CellBlock {
    /// Whether each cell has a value; `false` is VOID.
    pub present: Vec<bool>,
    /// The values' bytes; anything where there is none.
    pub values: Vec<u8>,
}

impl CellBlock {
    /// A block of so many VOID cells, with values of so many bytes.
    pub fn void(cells: usize, width: usize) -> CellBlock {
        CellBlock { present: vec![false; cells], values: vec![0; cells * width] }
    }
}

/// Everything that can be walked from the root down: a mapped file, a tree in memory, a view of either.
///
/// This is the `classify` and `subdivide` scheme of the octree literature: a source says VOID, LEAF or INNER
/// for a block and hands out its children on demand. A source need not be condensed (an INNER node may turn
/// out to be uniform), and its representatives need not be exact: what stores a tree condenses and averages
/// it anew.
pub trait Source: Sync {
    /// Handle of an inner node.
    type Node: Clone + Send + Sync;

    /// Quadtree or octree, and the type of the values.
    fn form(&self) -> TreeType;

    /// Number of levels below the root; nodes at this level are single cells and never INNER.
    fn depth(&self) -> u8;

    /// The whole space.
    ///
    /// # Errors
    /// If the source fails.
    fn root(&self) -> Result<Child<Self::Node>>;

    /// Writes the children of an inner node to the first entries, in child order.
    ///
    /// # Errors
    /// If the source fails.
    fn children(&self, node: &Self::Node, children: &mut Children<Self::Node>) -> Result<()>;

    /// All cells below an INNER node with so many levels below it, where a source has them faster than by its
    /// children.
    ///
    /// # Errors
    /// If the source fails.
    fn cells(&self, _: &Self::Node, _: u8) -> Result<Option<CellBlock>> {
        Ok(None)
    }

    /// Draws a box of cells inside the tree's space, x fastest, then y, then z: values, and which of them are
    /// not VOID. Returns whether the source can do that.
    ///
    /// # Errors
    /// If the source fails.
    fn draw(&self, _: &Bounds, _: &mut [u8], _: &mut [bool]) -> Result<bool> {
        Ok(false)
    }

    /// Makes sure that what was read is still there: that nobody has changed the file meanwhile. To be asked
    /// once at the end of a walk.
    ///
    /// # Errors
    /// If it was changed.
    fn check_unchanged(&self) -> Result<()> {
        Ok(())
    }

    /// Zone statistics of an INNER node, where the source has them without walking below it.
    ///
    /// # Errors
    /// If the source fails.
    fn tally(&self, _: &Self::Node) -> Result<Option<ZoneStats>> {
        Ok(None)
    }
}

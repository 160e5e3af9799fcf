//! Sources: everything that can be walked from the root down.

use std::fmt::Debug;

use crate::Result;
use crate::space::{Bounds, Dimension};
use crate::store::autumnal::Kept;
use crate::store::goblin::{Goblin, Handle, Layout};
use crate::value::{Tally, Value};

/// What stands at one place of a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Child<V, N> {
    /// Nothing: outside the data, no data, empty space.
    Void,
    /// One value all over.
    Leaf(V),
    /// More detail below.
    Inner {
        /// The one value that stands for the node at coarse detail.
        representative: V,
        /// What to ask the source with for the children.
        node: N,
    },
}

impl<V: Copy, N> Child<V, N> {
    /// The value at this place when nobody looks closer; `None` is VOID.
    pub fn value(&self) -> Option<V> {
        match self {
            Child::Void => None,
            Child::Leaf(value) => Some(*value),
            Child::Inner { representative, .. } => Some(*representative),
        }
    }

    /// The same place of a source that has other handles for its nodes.
    #[inline]
    pub fn map_node<M>(self, node_of: impl FnOnce(N) -> M) -> Child<V, M> {
        match self {
            Child::Void => Child::Void,
            Child::Leaf(value) => Child::Leaf(value),
            Child::Inner { representative, node } => Child::Inner { representative, node: node_of(node) },
        }
    }

    /// What it is as an index: 0 is VOID, 1 a LEAF, 2 INNER.
    #[inline]
    pub fn kind(&self) -> usize {
        match self {
            Child::Void => 0,
            Child::Leaf(_) => 1,
            Child::Inner { .. } => 2,
        }
    }

    /// Whether there is more detail below.
    pub fn is_inner(&self) -> bool {
        matches!(self, Child::Inner { .. })
    }
}

/// A node of a file, with all that is below it.
#[derive(Clone, Copy)]
pub struct Stored<'a, D: Layout, V: Value> {
    /// The file.
    pub file: &'a Goblin<D, V>,
    /// The node.
    pub node: Handle<D>,
}

/// What becomes of a node when two trees are settled into one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Nothing.
    Void,
    /// What this tree has, with all that is below it.
    Take(usize),
    /// Something that neither tree has.
    Fill,
    /// What becomes of its children.
    Split,
}

/// Verdicts by what each of two trees has at a node.
#[derive(Clone, Copy, Debug)]
pub struct Verdicts([[Verdict; 3]; 3]);

impl Verdicts {
    /// Asks once for each pair of [`Child::kind`]s.
    pub fn of(verdict: impl Fn([usize; 2]) -> Verdict) -> Verdicts {
        Verdicts(std::array::from_fn(|first| std::array::from_fn(|second| verdict([first, second]))))
    }

    /// The verdict for a pair of [`Child::kind`]s.
    #[inline]
    pub fn get(&self, [first, second]: [usize; 2]) -> Verdict {
        self.0[first][second]
    }
}

/// A node of two trees that are settled into one, cell by cell, with all that is below it.
#[derive(Clone, Copy)]
pub struct Overlay<'a, D: Layout, V: Value> {
    /// What the trees have there.
    pub places: [Child<V, Stored<'a, D, V>>; 2],
    /// How they are settled.
    pub verdicts: Verdicts,
}

/// Cells of a block in Z order.
#[derive(Clone, Debug, PartialEq)]
pub struct CellBlock<V> {
    /// 1 for cells with a value, 0 for VOID.
    pub present: Vec<u8>,
    /// The values; anything where there is none.
    pub values: Vec<V>,
}

impl<V: Value> CellBlock<V> {
    /// So many cells that are VOID.
    pub fn void(cells: usize) -> CellBlock<V> {
        CellBlock { present: vec![0; cells], values: vec![V::default(); cells] }
    }
}

/// Everything that can be walked from the root down: a mapped file, a tree in memory, a view of either.
///
/// This is the `classify` and `subdivide` scheme of the octree literature: a source says VOID, LEAF or INNER for a
/// block and hands out its children on demand. A source need not be condensed (an INNER node may turn out to be
/// uniform), and its representatives need not be exact: what stores a tree condenses and averages it anew.
pub trait Source {
    /// Quadtree or octree.
    type Dim: Dimension;
    /// Type of the values.
    type Value: Value;
    /// Handle of an inner node.
    type Node: Clone + Debug + Send + Sync;

    /// Number of levels below the root; nodes at this level are single cells and never INNER.
    fn depth(&self) -> u8;

    /// The whole space.
    fn root(&self) -> Result<Child<Self::Value, Self::Node>>;

    /// The children of an inner node, in child order.
    #[allow(clippy::type_complexity)] // an array of children: a name for it would hide more than it says
    fn children(
        &self,
        node: &Self::Node,
    ) -> Result<<Self::Dim as Dimension>::Array<Child<Self::Value, Self::Node>>> {
        let mut children = Self::Dim::array(|_| Child::Void);
        self.each_child(node, |step, child| {
            children.as_mut()[step] = child;
            Ok(())
        })?;
        Ok(children)
    }

    /// Hands out the children of an inner node with their numbers, in child order.
    ///
    /// # Errors
    /// If the source or `each` fails.
    fn each_child(
        &self,
        node: &Self::Node,
        each: impl FnMut(usize, Child<Self::Value, Self::Node>) -> Result<()>,
    ) -> Result<()>;

    /// All cells below an INNER node with so many levels below it, where a source has them faster than by its children.
    ///
    /// # Errors
    /// If the source fails.
    fn cells(&self, _: &Self::Node, _: u8) -> Result<Option<CellBlock<Self::Value>>> {
        Ok(None)
    }

    /// Draws a box of cells inside the tree's space, x fastest, then y, then z: values, and which of them are not VOID.
    /// Returns whether the source can do that.
    ///
    /// # Errors
    /// If the source fails.
    fn draw(&self, _: &Bounds, _: &mut [<Self::Value as Value>::Wire], _: &mut [bool]) -> Result<bool> {
        Ok(false)
    }

    /// The file and the node in it that an INNER node is, with all that is below it, if it is one of a file: what
    /// stores trees may then copy what is stored instead of asking for it.
    fn stored(&self, _: &Self::Node) -> Option<Stored<'_, Self::Dim, Self::Value>>
    where
        Self::Dim: Layout,
    {
        None
    }

    /// The node of an Autumnal file that an INNER node is, with all that is below it, if it is one: the file need not be
    /// written that again.
    fn kept(&self, _: &Self::Node) -> Option<Kept> {
        None
    }

    /// What is known of all the cells below an INNER node, where the source knows without looking.
    ///
    /// # Errors
    /// If the source fails.
    fn tally(&self, _: &Self::Node) -> Result<Option<Tally<Self::Value>>> {
        Ok(None)
    }

    /// The nodes of two files that an INNER node is made of, if it is no more than these, settled: what stores trees may
    /// then settle them itself, record by record.
    fn overlay(&self, _: &Self::Node) -> Option<Overlay<'_, Self::Dim, Self::Value>>
    where
        Self::Dim: Layout,
    {
        None
    }
}

/// What points to a source is one.
macro_rules! source_of_pointers {
    ($($Pointer:ty)*) => { $(
        impl<S: Source> Source for $Pointer {
            type Dim = S::Dim;
            type Value = S::Value;
            type Node = S::Node;

            fn depth(&self) -> u8 {
                (**self).depth()
            }

            fn root(&self) -> Result<Child<Self::Value, Self::Node>> {
                (**self).root()
            }

            fn each_child(
                &self,
                node: &Self::Node,
                each: impl FnMut(usize, Child<Self::Value, Self::Node>) -> Result<()>,
            ) -> Result<()> {
                (**self).each_child(node, each)
            }

            fn cells(&self, node: &Self::Node, levels: u8) -> Result<Option<CellBlock<Self::Value>>> {
                (**self).cells(node, levels)
            }

            fn draw(
                &self,
                bounds: &Bounds,
                values: &mut [<Self::Value as Value>::Wire],
                valid: &mut [bool],
            ) -> Result<bool> {
                (**self).draw(bounds, values, valid)
            }

            fn stored(&self, node: &Self::Node) -> Option<Stored<'_, Self::Dim, Self::Value>>
            where
                Self::Dim: Layout,
            {
                (**self).stored(node)
            }

            fn kept(&self, node: &Self::Node) -> Option<Kept> {
                (**self).kept(node)
            }

            fn tally(&self, node: &Self::Node) -> Result<Option<Tally<Self::Value>>> {
                (**self).tally(node)
            }

            fn overlay(&self, node: &Self::Node) -> Option<Overlay<'_, Self::Dim, Self::Value>>
            where
                Self::Dim: Layout,
            {
                (**self).overlay(node)
            }
        }
    )* };
}

source_of_pointers!(&S std::sync::Arc<S>);

//! Trees with parts of them changed.

use std::fmt::Debug;
use std::sync::Arc;

use super::source::{Child, Source, Stored};
use crate::Result;
use crate::query::node_bounds;
use crate::space::{Bounds, Code, Dimension as _};
use crate::store::autumnal::Kept;
use crate::store::goblin::Layout;
use crate::value::{Tally, Value};

/// What a patch does to a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change<V> {
    /// Nothing.
    Keep,
    /// All of it becomes one value, or VOID.
    Uniform(Option<V>),
    /// Different things to different children. Never said of a single cell.
    Split,
}

/// Changes to a tree.
pub trait Patch<D: Layout, V: Value>: Send + Sync {
    /// What becomes of a node, whose cells are `bounds`.
    fn change(&self, code: Code<D>, bounds: &Bounds) -> Change<V>;
}

/// A source with a patch on it. Where nothing changes it is the source, with all that is stored below.
pub struct Patched<S: Source<Dim: Layout>> {
    source: S,
    patch: Arc<dyn Patch<S::Dim, S::Value>>,
}

/// An INNER node of a patched source.
#[derive(Clone, Copy, Debug)]
pub enum PatchedNode<D: Layout, V: Value, N: Clone + Debug + Send + Sync> {
    /// The source's, as it is.
    Same(N),
    /// A place of the source below which something changes.
    Open(Code<D>, Child<V, N>),
}

impl<S: Source<Dim: Layout>> Patched<S> {
    /// Puts a patch on a source.
    pub fn new(source: S, patch: Arc<dyn Patch<S::Dim, S::Value>>) -> Self {
        Patched { source, patch }
    }

    /// What is patched.
    pub fn source(&self) -> &S {
        &self.source
    }

    #[allow(clippy::type_complexity)] // a place of the tree: a name for it would hide more than it says
    fn place(
        &self,
        code: Code<S::Dim>,
        place: Child<S::Value, S::Node>,
    ) -> Child<S::Value, PatchedNode<S::Dim, S::Value, S::Node>> {
        match self.patch.change(code, &node_bounds(code, self.source.depth())) {
            Change::Keep => place.map_node(PatchedNode::Same),
            Change::Uniform(value) => value.map_or(Child::Void, Child::Leaf),
            Change::Split => Child::Inner {
                representative: place.value().unwrap_or_default(),
                node: PatchedNode::Open(code, place),
            },
        }
    }
}

impl<S: Source<Dim: Layout>> Source for Patched<S> {
    type Dim = S::Dim;
    type Value = S::Value;
    type Node = PatchedNode<S::Dim, S::Value, S::Node>;

    fn depth(&self) -> u8 {
        self.source.depth()
    }

    fn root(&self) -> Result<Child<S::Value, Self::Node>> {
        Ok(self.place(Code::ROOT, self.source.root()?))
    }

    fn each_child(
        &self,
        node: &Self::Node,
        mut each: impl FnMut(usize, Child<S::Value, Self::Node>) -> Result<()>,
    ) -> Result<()> {
        match node {
            PatchedNode::Same(node) => {
                self.source.each_child(node, |step, child| each(step, child.map_node(PatchedNode::Same)))
            }
            PatchedNode::Open(code, Child::Inner { node, .. }) => {
                self.source.each_child(node, |step, child| each(step, self.place(code.child(step), child)))
            }
            PatchedNode::Open(code, place) => (0..S::Dim::CHILDREN)
                .try_for_each(|step| each(step, self.place(code.child(step), place.clone()))),
        }
    }

    fn stored(&self, node: &Self::Node) -> Option<Stored<'_, S::Dim, S::Value>> {
        match node {
            PatchedNode::Same(node) => self.source.stored(node),
            PatchedNode::Open(..) => None,
        }
    }

    fn kept(&self, node: &Self::Node) -> Option<Kept> {
        match node {
            PatchedNode::Same(node) => self.source.kept(node),
            PatchedNode::Open(..) => None,
        }
    }

    fn tally(&self, node: &Self::Node) -> Result<Option<Tally<S::Value>>> {
        match node {
            PatchedNode::Same(node) => self.source.tally(node),
            PatchedNode::Open(..) => Ok(None),
        }
    }
}

//! The tree in memory: for small trees, and the referee of the tests.

use crate::Result;
use crate::space::{Cell, Code, Dimension};
use crate::value::{Rule, Tally, Value, representative};

use super::source::{Child, Source};

/// A tree whose nodes all lie in memory; always condensed (no INNER node has equal LEAF or only VOID children).
#[derive(Clone, Debug)]
pub struct MemTree<D: Dimension, V: Value> {
    pub(super) depth: u8,
    pub(super) root: Child<V, usize>,
    /// Inner nodes, children before parents.
    pub(super) inner: Vec<D::Array<Child<V, usize>>>,
}

impl<D: Dimension, V: Value> MemTree<D, V> {
    /// The tree of the cells that a function gives; `None` is VOID. Takes time proportional to the cells.
    ///
    /// # Panics
    /// If `depth` is more than the dimension allows.
    pub fn from_cells(depth: u8, rule: Rule, cell: impl Fn(Cell) -> Option<V>) -> MemTree<D, V> {
        assert!(depth <= D::MAX_DEPTH);
        let mut builder = Builder::<D, V>::new(rule);
        let (root, _) = builder.cells(Code::ROOT, depth, &cell);
        MemTree { depth, root, inner: builder.inner }
    }

    /// A condensed copy of any source, with representatives by `rule`.
    ///
    /// # Errors
    /// If the source fails. It is for small trees: all nodes go to memory.
    pub fn from_source<S: Source<Dim = D, Value = V>>(source: &S, rule: Rule) -> Result<MemTree<D, V>> {
        let mut builder = Builder::<D, V>::new(rule);
        let (root, _) = builder.places(source, source.root()?, source.depth())?;
        Ok(MemTree { depth: source.depth(), root, inner: builder.inner })
    }

    /// Number of INNER nodes, which is the number of records that store the tree.
    pub fn inner_nodes(&self) -> usize {
        self.inner.len()
    }

    /// The value at a node's place: its own, or that of the LEAF it lies in; `None` is VOID.
    pub fn value_at(&self, code: Code<D>) -> Option<V> {
        let mut place = self.root;
        for step in code.digits() {
            match place {
                Child::Inner { node, .. } => place = self.inner[node].as_ref()[step],
                _ => break,
            }
        }
        place.value()
    }
}

impl<D: Dimension, V: Value> Source for MemTree<D, V> {
    type Dim = D;
    type Value = V;
    type Node = usize;

    fn depth(&self) -> u8 {
        self.depth
    }

    fn root(&self) -> Result<Child<V, usize>> {
        Ok(self.root)
    }

    fn each_child(
        &self,
        node: &usize,
        mut each: impl FnMut(usize, Child<V, usize>) -> Result<()>,
    ) -> Result<()> {
        let mut children = self.inner[*node].as_ref().iter().enumerate();
        children.try_for_each(|(step, child)| each(step, *child))
    }
}

/// Condenses and averages bottom-up.
struct Builder<D: Dimension, V: Value> {
    rule: Rule,
    inner: Vec<D::Array<Child<V, usize>>>,
}

type Built<V> = (Child<V, usize>, Tally<V>);

impl<D: Dimension, V: Value> Builder<D, V> {
    fn new(rule: Rule) -> Self {
        Builder { rule, inner: Vec::new() }
    }

    fn cells(&mut self, code: Code<D>, depth: u8, cell: &impl Fn(Cell) -> Option<V>) -> Built<V> {
        if code.level() == depth {
            return self.uniform(cell(code.cell()), 1);
        }
        let parts = (0..D::CHILDREN).map(|i| self.cells(code.child(i), depth, cell)).collect();
        self.join(parts, depth - code.level())
    }

    fn places<S: Source<Dim = D, Value = V>>(
        &mut self,
        source: &S,
        place: Child<V, S::Node>,
        height: u8,
    ) -> Result<Built<V>> {
        match place {
            Child::Inner { node, .. } => {
                let parts = source.children(&node)?.into_iter();
                let parts: Result<_> =
                    parts.map(|child| self.places(source, child, height.saturating_sub(1))).collect();
                Ok(self.join(parts?, height))
            }
            _ => Ok(self.uniform(place.value(), 1 << (D::AXES * height as usize))),
        }
    }

    fn uniform(&self, value: Option<V>, cells: u64) -> Built<V> {
        match value {
            None => (Child::Void, Tally::void()),
            Some(value) => (Child::Leaf(value), Tally::leaf(value, cells, self.rule == Rule::Majority)),
        }
    }

    fn join(&mut self, parts: Vec<Built<V>>, height: u8) -> Built<V> {
        let tally = Tally::merge(&parts.iter().map(|(_, tally)| tally).collect::<Vec<_>>());
        let children = D::array(|i| parts[i].0);
        let first = parts[0].0;
        let uniform = parts.iter().all(|(child, _)| match (first, child) {
            (Child::Void, Child::Void) => true,
            (Child::Leaf(a), Child::Leaf(b)) => a.same(*b),
            _ => false,
        });
        if uniform {
            return (first, tally);
        }
        let values: Vec<_> =
            parts.iter().map(|(child, _)| child.value().map(|value| (value, child.is_inner()))).collect();
        let cells = 1 << (D::AXES * height as usize);
        let representative = representative(self.rule, &values, &tally, cells);
        self.inner.push(children);
        (Child::Inner { representative, node: self.inner.len() - 1 }, tally)
    }
}

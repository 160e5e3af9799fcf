//! The tree in memory: for small trees, and as the reference in tests.

use super::source::{Child, Children, Source, no_children};
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::space::{Cell, Code};
use spinney_base::value::{Rule, Value, ZoneStats, representative};

/// A tree with all nodes in memory. It is always condensed: no INNER node has children that are all
/// VOID, or LEAFs of equal value.
#[derive(Clone, Debug)]
pub struct MemTree {
    pub(super) form: TreeType,
    pub(super) depth: u8,
    pub(super) root: Child<usize>,
    /// INNER nodes, children before parents.
    pub(super) inner: Vec<Children<usize>>,
}

impl MemTree {
    /// Builds a tree from a function that returns the value of each cell; `None` is VOID. Takes
    /// time in proportion to the cells.
    ///
    /// # Panics
    /// If `depth` is more than the dimension allows.
    pub fn from_cells(
        form: TreeType,
        depth: u8,
        rule: Rule,
        cell: &dyn Fn(Cell) -> Option<Value>,
    ) -> MemTree {
        assert!(depth <= form.dimension.max_depth());
        let mut builder = Builder { form, rule, inner: Vec::new() };
        let (root, _) = builder.cells(Code::root(form.dimension), depth, cell);
        MemTree { form, depth, root, inner: builder.inner }
    }

    /// Copies any source to a condensed tree, with representatives by `rule`. For small trees: all
    /// nodes are kept in memory.
    ///
    /// # Errors
    /// If the source fails.
    pub fn from_source<S: Source>(source: &S, rule: Rule) -> Result<MemTree> {
        let (form, depth) = (source.form(), source.depth());
        let mut builder = Builder { form, rule, inner: Vec::new() };
        let (root, _) = builder.nodes(source, source.root()?, depth)?;
        Ok(MemTree { form, depth, root, inner: builder.inner })
    }

    /// Returns the number of INNER nodes, which is the number of records that store the tree.
    pub fn inner_nodes(&self) -> usize {
        self.inner.len()
    }

    /// Returns the value of a node: its own, or that of the LEAF it is in; `None` is VOID.
    pub fn value_at(&self, code: Code) -> Option<Value> {
        let mut child = self.root;
        for step in code.digits() {
            match child {
                Child::Inner { node, .. } => child = self.inner[node][step],
                _ => break,
            }
        }
        child.value()
    }
}

impl Source for MemTree {
    type Node = usize;

    fn form(&self) -> TreeType {
        self.form
    }

    fn depth(&self) -> u8 {
        self.depth
    }

    fn root(&self) -> Result<Child<usize>> {
        Ok(self.root)
    }

    fn children(&self, node: &usize, children: &mut Children<usize>) -> Result<()> {
        *children = self.inner[*node];
        Ok(())
    }
}

/// Condenses the tree and computes representatives, bottom-up.
struct Builder {
    form: TreeType,
    rule: Rule,
    inner: Vec<Children<usize>>,
}

type Built = (Child<usize>, ZoneStats);

impl Builder {
    fn cells(&mut self, code: Code, depth: u8, cell: &dyn Fn(Cell) -> Option<Value>) -> Built {
        if code.level() == depth {
            return self.uniform(cell(code.cell()), 1);
        }
        let parts = (0..self.form.children()).map(|i| self.cells(code.child(i), depth, cell)).collect();
        self.join(parts, depth - code.level())
    }

    fn nodes<S: Source>(&mut self, source: &S, child: Child<S::Node>, height: u8) -> Result<Built> {
        let Child::Inner { node, .. } = child else {
            return Ok(self.uniform(child.value(), self.form.dimension.cells(height)));
        };
        let mut children = no_children();
        source.children(&node, &mut children)?;
        let children = children.into_iter().take(self.form.children());
        let parts: Result<_> =
            children.map(|child| self.nodes(source, child, height.saturating_sub(1))).collect();
        Ok(self.join(parts?, height))
    }

    fn uniform(&self, value: Option<Value>, cells: u64) -> Built {
        let tally = match value {
            None => ZoneStats::void(self.form.value),
            Some(value) => ZoneStats::leaf(self.form.value, value, cells, self.rule == Rule::Majority),
        };
        (Child::uniform(value), tally)
    }

    fn join(&mut self, parts: Vec<Built>, height: u8) -> Built {
        let tally = ZoneStats::merge(&parts.iter().map(|(_, tally)| tally).collect::<Vec<_>>());
        let mut children = no_children();
        for (child, (part, _)) in children.iter_mut().zip(&parts) {
            *child = *part;
        }
        let first = children[0];
        if !first.is_inner() && parts.iter().all(|(child, _)| *child == first) {
            return (first, tally);
        }
        let values: Vec<_> =
            parts.iter().map(|(child, _)| child.value().map(|value| (value, child.is_inner()))).collect();
        let cells = self.form.dimension.cells(height);
        let representative = representative(self.rule, &values, &tally, cells);
        self.inner.push(children);
        (Child::Inner { representative, node: self.inner.len() - 1 }, tally)
    }
}

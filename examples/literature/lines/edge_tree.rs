//! Quadtrees and octrees of edges.

use std::collections::{BTreeSet, BinaryHeap};

use super::clip::passes;
use super::distance::{Square, of_box, of_edge};
use super::rule::PmRule;

/// Two vertices.
pub(super) type Edge<const N: usize> = [[i32; N]; 2];

/// A quadtree (`N` is 2) or an octree (3) of edges between vertices of whole numbers from 0 to 2^depth, that excluded.
#[derive(Clone, Debug)]
pub(crate) struct EdgeTree<const N: usize> {
    rule: PmRule,
    depth: u8,
    root: Node<N>,
    /// All edges, each with its lesser vertex first.
    edges: BTreeSet<Edge<N>>,
}

/// A leaf that has edges.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct EdgeLeaf<const N: usize> {
    /// Its least corner.
    pub corner: [i32; N],
    /// Its side.
    pub side: i32,
    /// The edges that pass through it, in order, each with its lesser vertex first.
    pub edges: Vec<[[i32; N]; 2]>,
}

#[derive(Clone, Debug)]
enum Node<const N: usize> {
    Leaf(Vec<Edge<N>>),
    Inner(Vec<Node<N>>),
}

/// A block of the space.
#[derive(Clone, Copy)]
struct Block<const N: usize> {
    corner: [i32; N],
    /// Its side is 2^levels.
    levels: u8,
}

impl<const N: usize> Block<N> {
    fn child(&self, number: usize) -> Block<N> {
        let levels = self.levels - 1;
        let corner = std::array::from_fn(|axis| self.corner[axis] + ((number >> axis & 1) << levels) as i32);
        Block { corner, levels }
    }

    fn sides(&self) -> ([i64; N], [i64; N]) {
        let low = self.corner.map(i64::from);
        (low, low.map(|at| at + (1 << self.levels)))
    }

    fn has(&self, vertex: [i32; N]) -> bool {
        (0..N).all(|axis| (vertex[axis] - self.corner[axis]) >> self.levels == 0)
    }

    fn is_passed(&self, edge: Edge<N>) -> bool {
        passes(edge, self.sides(), false)
    }
}

/// The edge with its lesser vertex first.
fn ordered<const N: usize>([a, b]: Edge<N>) -> Edge<N> {
    if a <= b { [a, b] } else { [b, a] }
}

impl<const N: usize> EdgeTree<N> {
    const AXES: () = assert!(N == 2 || N == 3);

    /// A tree without edges; its smallest blocks have one place, and take whatever edges they have.
    ///
    /// # Panics
    /// If the depth is above 29.
    pub(crate) fn new(rule: PmRule, depth: u8) -> EdgeTree<N> {
        let () = Self::AXES;
        assert!(depth <= 29);
        EdgeTree { rule, depth, root: Node::Leaf(Vec::new()), edges: BTreeSet::new() }
    }

    /// The tree of many edges, made from the root down: a block's edges are clipped to each of its parts. It is the one that inserting them makes. Those beyond its space are left out.
    ///
    /// # Panics
    /// If the depth is above 29.
    pub(crate) fn of(rule: PmRule, depth: u8, edges: impl IntoIterator<Item = [[i32; N]; 2]>) -> EdgeTree<N> {
        let mut tree = EdgeTree::new(rule, depth);
        let block = tree.block();
        tree.edges =
            edges.into_iter().map(ordered).filter(|edge| edge.iter().all(|end| block.has(*end))).collect();
        tree.root = Node::of(tree.edges.iter().copied().collect(), block, rule);
        tree
    }

    fn block(&self) -> Block<N> {
        Block { corner: [0; N], levels: self.depth }
    }

    /// Inserts an edge, which may be a vertex alone; `false` if it is there, in either direction, or is not in the tree's space.
    pub(crate) fn insert(&mut self, edge: [[i32; N]; 2]) -> bool {
        let (edge, block) = (ordered(edge), self.block());
        if !edge.iter().all(|vertex| block.has(*vertex)) || !self.edges.insert(edge) {
            return false;
        }
        self.root.insert(edge, block, self.rule);
        true
    }

    /// Removes an edge; `false` if it is not there. Blocks that need no division any more are merged.
    pub(crate) fn remove(&mut self, edge: [[i32; N]; 2]) -> bool {
        let edge = ordered(edge);
        let is_there = self.edges.remove(&edge);
        if is_there {
            self.root.remove(edge, self.block(), self.rule);
        }
        is_there
    }

    /// Number of edges.
    pub(crate) fn len(&self) -> usize {
        self.edges.len()
    }

    /// Whether there are none.
    pub(crate) fn is_empty(&self) -> bool {
        self.edges.is_empty()
    }

    /// The edges that pass through a box, its border included, in order.
    pub(crate) fn window(&self, least: [i32; N], most: [i32; N]) -> Vec<[[i32; N]; 2]> {
        let window = (least.map(i64::from), most.map(i64::from));
        if (0..N).any(|axis| least[axis] > most[axis]) {
            return Vec::new();
        }
        let mut found = BTreeSet::new();
        let mut open = vec![(&self.root, self.block())];
        while let Some((node, block)) = open.pop() {
            let (low, high) = block.sides();
            if !(0..N).all(|axis| low[axis] <= window.1[axis] && window.0[axis] < high[axis]) {
                continue;
            }
            match node {
                Node::Leaf(edges) => found.extend(edges.iter().filter(|edge| passes(**edge, window, true))),
                Node::Inner(children) => {
                    open.extend(
                        children.iter().enumerate().map(|(number, child)| (child, block.child(number))),
                    );
                }
            }
        }
        found.into_iter().collect()
    }

    /// The edge nearest to a place of the tree's space, and its distance: of those that are equally far, the first in order. Distances are compared exactly.
    ///
    /// # Panics
    /// If a coordinate is below 0, or 2^29 or more.
    pub(crate) fn nearest(&self, place: [i32; N]) -> Option<([[i32; N]; 2], f64)> {
        assert!(place.iter().all(|number| (0..1 << 29).contains(number)));
        let mut best: Option<(Square, Edge<N>)> = None;
        // Blocks, the nearest first, by where they stand in the list.
        let mut blocks = vec![(&self.root, self.block())];
        let mut open = BinaryHeap::from([std::cmp::Reverse((of_box(self.block().sides(), place), 0))]);
        while let Some(std::cmp::Reverse((square, number))) = open.pop() {
            if best.is_some_and(|(least, _)| square > least) {
                break;
            }
            let (node, block) = blocks[number];
            match node {
                Node::Leaf(edges) => {
                    let nearest = edges.iter().map(|edge| (of_edge(*edge, place), *edge)).min();
                    best = best.into_iter().chain(nearest).min();
                }
                Node::Inner(children) => {
                    for (number, child) in children.iter().enumerate() {
                        let block = block.child(number);
                        open.push(std::cmp::Reverse((of_box(block.sides(), place), blocks.len())));
                        blocks.push((child, block));
                    }
                }
            }
        }
        best.map(|(square, edge)| (edge, square.to_f64().sqrt()))
    }

    /// The leaves that have edges, in Z order.
    pub(crate) fn leaves(&self) -> Vec<EdgeLeaf<N>> {
        let mut leaves = Vec::new();
        let mut open = vec![(&self.root, self.block())];
        while let Some((node, block)) = open.pop() {
            match node {
                Node::Leaf(edges) if edges.is_empty() => {}
                Node::Leaf(edges) => {
                    let mut edges = edges.clone();
                    edges.sort_unstable();
                    leaves.push(EdgeLeaf { corner: block.corner, side: 1 << block.levels, edges });
                }
                Node::Inner(children) => {
                    open.extend(
                        children.iter().enumerate().rev().map(|(number, child)| (child, block.child(number))),
                    );
                }
            }
        }
        leaves
    }

    /// Number of leaves, and of nodes above them.
    pub(crate) fn counts(&self) -> (usize, usize) {
        let (mut leaves, mut inner) = (0, 0);
        let mut open = vec![&self.root];
        while let Some(node) = open.pop() {
            match node {
                Node::Leaf(_) => leaves += 1,
                Node::Inner(children) => {
                    inner += 1;
                    open.extend(children);
                }
            }
        }
        (leaves, inner)
    }

    /// The tree as a DF-expression: `G` for a node that is divided, `B` for a leaf with edges, `W` for one without.
    pub(crate) fn to_df_expression(&self) -> String {
        let mut text = String::new();
        let mut open = vec![&self.root];
        while let Some(node) = open.pop() {
            match node {
                Node::Leaf(edges) => text.push(if edges.is_empty() { 'W' } else { 'B' }),
                Node::Inner(children) => {
                    text.push('G');
                    open.extend(children.iter().rev());
                }
            }
        }
        text
    }
}

// (Blocks go no deeper than 29 levels, so that recursion is bounded.)
impl<const N: usize> Node<N> {
    fn of(edges: Vec<Edge<N>>, block: Block<N>, rule: PmRule) -> Node<N> {
        if block.levels == 0 || rule.holds(&edges, |vertex| block.has(vertex)) {
            return Node::Leaf(edges);
        }
        let children = (0..1 << N).map(|number| {
            let child = block.child(number);
            let own = edges.iter().copied().filter(|edge| child.is_passed(*edge)).collect();
            Node::of(own, child, rule)
        });
        Node::Inner(children.collect())
    }

    fn insert(&mut self, edge: Edge<N>, block: Block<N>, rule: PmRule) {
        if !block.is_passed(edge) {
            return;
        }
        match self {
            Node::Leaf(edges) => {
                edges.push(edge);
                let edges = std::mem::take(edges);
                *self = Node::of(edges, block, rule);
            }
            Node::Inner(children) => {
                for (number, child) in children.iter_mut().enumerate() {
                    child.insert(edge, block.child(number), rule);
                }
            }
        }
    }

    fn remove(&mut self, edge: Edge<N>, block: Block<N>, rule: PmRule) {
        if !block.is_passed(edge) {
            return;
        }
        match self {
            Node::Leaf(edges) => edges.retain(|own| *own != edge),
            Node::Inner(children) => {
                for (number, child) in children.iter_mut().enumerate() {
                    child.remove(edge, block.child(number), rule);
                }
                // (Where a child is divided, no rule that does not hold for its edges holds for more.)
                let mut all = BTreeSet::new();
                for child in children.iter() {
                    let Node::Leaf(edges) = child else { return };
                    all.extend(edges.iter().copied());
                }
                let all: Vec<Edge<N>> = all.into_iter().collect();
                if rule.holds(&all, |vertex| block.has(vertex)) {
                    *self = Node::Leaf(all);
                }
            }
        }
    }
}

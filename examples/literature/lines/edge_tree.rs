//! Quadtrees and octrees of edges.

use std::collections::{BTreeSet, BinaryHeap};

use super::clip::passes;
use super::distance::{Square, of_box, of_edge};
use super::rule::PmRule;

/// Two vertices.
pub(super) type Edge<const N: usize> = [[i32; N]; 2];

/// Quadtree (`N` is 2) or octree (3) of edges between integer vertices from 0 to 2^depth,
/// exclusive.
#[derive(Clone, Debug)]
pub(crate) struct EdgeTree<const N: usize> {
    rule: PmRule,
    depth: u8,
    root: Node<N>,
    /// All edges, each with its smaller vertex first.
    edges: BTreeSet<Edge<N>>,
}

/// Leaf with edges.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct EdgeLeaf<const N: usize> {
    /// Minimum corner.
    pub corner: [i32; N],
    /// Length of a side.
    pub side: i32,
    /// Edges that intersect the leaf, in order, each with its smaller vertex first.
    pub edges: Vec<[[i32; N]; 2]>,
}

#[derive(Clone, Debug)]
enum Node<const N: usize> {
    Leaf(Vec<Edge<N>>),
    Inner(Vec<Node<N>>),
}

/// Block of the space.
#[derive(Clone, Copy)]
struct Block<const N: usize> {
    corner: [i32; N],
    /// The side is 2^levels.
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

/// Returns the edge with its smaller vertex first.
fn ordered<const N: usize>([a, b]: Edge<N>) -> Edge<N> {
    if a <= b { [a, b] } else { [b, a] }
}

impl<const N: usize> EdgeTree<N> {
    const AXES: () = assert!(N == 2 || N == 3);

    /// Creates a tree without edges. Its smallest blocks have a single point, and any number of
    /// edges.
    ///
    /// # Panics
    /// If the depth is above 29.
    pub(crate) fn new(rule: PmRule, depth: u8) -> EdgeTree<N> {
        let () = Self::AXES;
        assert!(depth <= 29);
        EdgeTree { rule, depth, root: Node::Leaf(Vec::new()), edges: BTreeSet::new() }
    }

    /// Builds the tree of many edges from the root down, clipping a block's edges to each of its
    /// children. The result is the same as by insertion. Edges outside of the space are ignored.
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

    /// Inserts an edge, which may be a single vertex. Returns `false` if it exists already, in
    /// either direction, or is outside of the tree's space.
    pub(crate) fn insert(&mut self, edge: [[i32; N]; 2]) -> bool {
        let (edge, block) = (ordered(edge), self.block());
        if !edge.iter().all(|vertex| block.has(*vertex)) || !self.edges.insert(edge) {
            return false;
        }
        self.root.insert(edge, block, self.rule);
        true
    }

    /// Removes an edge; returns `false` if it does not exist. Blocks that need no division any more
    /// are merged.
    pub(crate) fn remove(&mut self, edge: [[i32; N]; 2]) -> bool {
        let edge = ordered(edge);
        let is_there = self.edges.remove(&edge);
        if is_there {
            self.root.remove(edge, self.block(), self.rule);
        }
        is_there
    }

    /// Returns the number of edges.
    pub(crate) fn len(&self) -> usize {
        self.edges.len()
    }

    /// Returns whether there are no edges.
    pub(crate) fn is_empty(&self) -> bool {
        self.edges.is_empty()
    }

    /// Returns the edges that intersect a box, its border included, in order.
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

    /// Returns the edge nearest to a point of the tree's space, and its distance; of several the
    /// first in order. Distances are compared exactly.
    ///
    /// # Panics
    /// If a coordinate is negative, or 2^29 or more.
    pub(crate) fn nearest(&self, place: [i32; N]) -> Option<([[i32; N]; 2], f64)> {
        assert!(place.iter().all(|number| (0..1 << 29).contains(number)));
        let mut best: Option<(Square, Edge<N>)> = None;
        // Blocks by index into the list, nearest first.
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

    /// Returns the leaves that have edges, in Z order.
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

    /// Returns the number of leaves, and of inner nodes.
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

    /// Returns the tree as a DF-expression: `G` for a node that is divided, `B` for a leaf with
    /// edges, `W` for one without.
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

// (Blocks are at most 29 levels deep, so that recursion is bounded.)
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
                // (If a child is divided, its edges break the rule, and so does every superset.)
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

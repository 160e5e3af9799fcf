//! Quadtrees and octrees of edges.

use std::collections::BTreeSet;

use spinney_base::space::Dimension;

use super::clip::passes;
use super::rule::PmRule;

/// Two vertices; in a quadtree, z is 0.
pub(super) type Edge = [[i64; 3]; 2];

/// Quadtree or octree of edges between integer vertices from 0 to 2^depth, exclusive.
#[derive(Clone, Debug)]
pub struct EdgeTree {
    dimension: Dimension,
    depth: u8,
    root: Node,
}

/// Leaf with edges.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EdgeLeaf {
    /// Minimum corner.
    pub corner: [i64; 3],
    /// Length of a side.
    pub side: i64,
    /// Edges that intersect the leaf, in order, each with its smaller vertex first.
    pub edges: Vec<[[i64; 3]; 2]>,
}

/// Sizes of a tree of edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EdgeTreeCounts {
    /// Number of leaves without edges, and of those with edges.
    pub empty: usize,
    /// Number of leaves with edges.
    pub full: usize,
    /// Number of nodes that are divided.
    pub divided: usize,
    /// Total number of edges in leaves; an edge counts once for each leaf that it intersects.
    pub stored: usize,
    /// Deepest level of a leaf.
    pub depth: u8,
}

#[derive(Clone, Debug)]
enum Node {
    Leaf(Vec<Edge>),
    Divided(Vec<Node>),
}

/// Block of the space.
#[derive(Clone, Copy)]
struct Block {
    corner: [i64; 3],
    /// The side is 2^levels.
    levels: u8,
}

impl Block {
    fn child(&self, number: usize, dimension: Dimension) -> Block {
        let levels = self.levels - 1;
        let mut corner = self.corner;
        for (axis, at) in corner.iter_mut().enumerate().take(dimension.axes()) {
            *at += ((number >> axis & 1) as i64) << levels;
        }
        Block { corner, levels }
    }

    /// Minimum and maximum corner. (In a quadtree z is from 0 on, so that all edges are in it.)
    fn sides(&self) -> [[i64; 3]; 2] {
        [self.corner, self.corner.map(|at| at + (1 << self.levels))]
    }

    fn has(&self, vertex: [i64; 3]) -> bool {
        (0..3).all(|axis| (vertex[axis] - self.corner[axis]) >> self.levels == 0)
    }
}

impl EdgeTree {
    /// Maximum depth.
    pub const MAX_DEPTH: u8 = 32;

    /// Builds a tree from the root down, clipping a block's edges to each of its children. Its
    /// smallest blocks have a single point, and any number of edges. Equal edges are one, in either
    /// direction; those outside of the space are ignored. `None` if leaves would have more than
    /// `limit` edges in total.
    ///
    /// # Panics
    /// If the depth is above 32.
    pub fn of(
        rule: PmRule,
        (dimension, depth): (Dimension, u8),
        edges: impl IntoIterator<Item = [[i64; 3]; 2]>,
        limit: usize,
    ) -> Option<EdgeTree> {
        assert!(depth <= EdgeTree::MAX_DEPTH);
        let block = Block { corner: [0; 3], levels: depth };
        let ordered = |[a, b]: Edge| if a <= b { [a, b] } else { [b, a] };
        let all: BTreeSet<Edge> =
            edges.into_iter().map(ordered).filter(|edge| edge.iter().all(|end| block.has(*end))).collect();
        let mut left = limit;
        let root = Node::of(all.into_iter().collect(), block, (rule, dimension), &mut left)?;
        Some(EdgeTree { dimension, depth, root })
    }

    /// Returns the leaves that have edges, in Z order.
    pub fn leaves(&self) -> Vec<EdgeLeaf> {
        let mut leaves = Vec::new();
        self.each(&mut |node, block| match node {
            Node::Leaf(edges) if !edges.is_empty() => {
                leaves.push(EdgeLeaf { corner: block.corner, side: 1 << block.levels, edges: edges.clone() });
            }
            _ => {}
        });
        leaves
    }

    /// Returns the numbers of nodes and edges.
    pub fn counts(&self) -> EdgeTreeCounts {
        let mut counts = EdgeTreeCounts::default();
        self.each(&mut |node, block| match node {
            Node::Divided(_) => counts.divided += 1,
            Node::Leaf(edges) => {
                *if edges.is_empty() { &mut counts.empty } else { &mut counts.full } += 1;
                counts.stored += edges.len();
                counts.depth = counts.depth.max(self.depth - block.levels);
            }
        });
        counts
    }

    /// Returns the tree as a DF-expression: `G` (in an octree `M`) for a node that is divided, `B`
    /// (`F`) for a leaf with edges, `W` (`V`) for one without.
    pub fn to_df_expression(&self) -> String {
        let [divided, full, empty] = match self.dimension {
            Dimension::Quad => ['G', 'B', 'W'],
            Dimension::Oct => ['M', 'F', 'V'],
        };
        let mut text = String::new();
        self.each(&mut |node, _| {
            text.push(match node {
                Node::Divided(_) => divided,
                Node::Leaf(edges) if edges.is_empty() => empty,
                Node::Leaf(_) => full,
            });
        });
        text
    }

    /// Visits all nodes in preorder.
    fn each(&self, visit: &mut dyn FnMut(&Node, Block)) {
        let mut open = vec![(&self.root, Block { corner: [0; 3], levels: self.depth })];
        while let Some((node, block)) = open.pop() {
            visit(node, block);
            if let Node::Divided(children) = node {
                let children = children.iter().enumerate().rev();
                open.extend(children.map(|(number, child)| (child, block.child(number, self.dimension))));
            }
        }
    }
}

impl Node {
    /// (Blocks are at most 32 levels deep, so that recursion is bounded.)
    fn of(
        edges: Vec<Edge>,
        block: Block,
        (rule, dimension): (PmRule, Dimension),
        left: &mut usize,
    ) -> Option<Node> {
        if block.levels == 0 || rule.holds(&edges, &|vertex| block.has(vertex)) {
            *left = left.checked_sub(edges.len())?;
            return Some(Node::Leaf(edges));
        }
        let children = (0..1 << dimension.axes()).map(|number| {
            let child = block.child(number, dimension);
            let own = edges.iter().copied().filter(|edge| passes(*edge, child.sides(), false)).collect();
            Node::of(own, child, (rule, dimension), left)
        });
        children.collect::<Option<Vec<_>>>().map(Node::Divided)
    }
}

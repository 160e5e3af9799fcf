//! Conditions for the division of a block.

use super::edge_tree::Edge;

/// Rule for the edges of a leaf that could be divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PmRule {
    /// One vertex with its edges, or a section of one edge: the PM1 quadtree, and the octree of
    /// edges.
    Pm1,
    /// One vertex with its edges, or sections of edges that share one vertex outside of the leaf.
    Pm2,
    /// At most one vertex, and sections of any edges.
    Pm3,
    /// At most this many edges; or any number of edges of a single vertex in the leaf, which no
    /// division would separate.
    Bucket(usize),
    /// None: leaves with edges are pixels.
    Pixels,
}

impl PmRule {
    /// Returns whether a leaf may have these edges, all of which intersect it; `is_inside` tests
    /// whether a vertex is in the leaf.
    pub(super) fn holds(self, edges: &[Edge], is_inside: &dyn Fn([i64; 3]) -> bool) -> bool {
        let Some(first) = edges.first() else { return true };
        // The vertex inside, if there is one, and whether there is another one.
        let mut inside = edges.iter().flatten().filter(|vertex| is_inside(**vertex));
        let vertex = inside.next();
        let has_others = inside.any(|other| Some(other) != vertex);
        let all_have = |vertex: &[i64; 3]| edges.iter().all(|edge| edge.contains(vertex));
        match (self, vertex) {
            (PmRule::Pixels, _) => false,
            (PmRule::Bucket(most), _) if edges.len() <= most => true,
            (PmRule::Bucket(_), vertex) => !has_others && vertex.is_some_and(all_have),
            (PmRule::Pm3, _) => !has_others,
            (PmRule::Pm1 | PmRule::Pm2, Some(vertex)) => !has_others && all_have(vertex),
            (PmRule::Pm1, None) => edges.len() == 1,
            (PmRule::Pm2, None) => edges.len() == 1 || first.iter().any(all_have),
        }
    }
}

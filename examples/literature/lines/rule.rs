//! When a block is divided.

use super::edge_tree::Edge;

/// Rule for the edges that a leaf may have, if it can be divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PmRule {
    /// One vertex with its edges, or a part of one edge: the PM1 quadtree, and the octree of edges.
    Pm1,
    /// One vertex with its edges, or parts of edges that all have one vertex, which is elsewhere.
    Pm2,
    /// One vertex at most, and parts of any edges.
    Pm3,
    /// So many edges at most; or any number of a vertex that is in the leaf, which no division would part.
    Bucket(usize),
    /// None: leaves that have any are pixels.
    Pixels,
}

impl PmRule {
    /// Whether a leaf may have these edges, all of which pass through it; `is_inside` tells which vertices it has.
    pub(super) fn holds<const N: usize>(
        self,
        edges: &[Edge<N>],
        is_inside: impl Fn([i32; N]) -> bool,
    ) -> bool {
        let Some(first) = edges.first() else { return true };
        // The vertex inside, if there is one, and whether there is another one.
        let mut inside = edges.iter().flatten().filter(|vertex| is_inside(**vertex));
        let vertex = inside.next();
        let has_others = inside.any(|other| Some(other) != vertex);
        let all_have = |vertex: &[i32; N]| edges.iter().all(|edge| edge.contains(vertex));
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

//! Trees of edges from the literature: the PM quadtrees of polygonal maps (Samet and Webber 1985),
//! their bucket variant, quadtrees of the pixels that lines intersect, and the same in space, where
//! the first rule makes the octree of edges.
//!
//! Blocks are half-open: they include their minimum sides, but not their maximum ones. So each
//! vertex is in exactly one leaf, also on a dividing line; an edge along such a line is in the
//! blocks on its far side. (With closed blocks a vertex on a dividing line would be in two or four
//! leaves, and edges that end there would be neighbours of unrelated ones.) Whether an edge
//! intersects a block is decided in integers. A tree depends only on its edges, not on their order.

mod clip;
mod edge_tree;
mod rule;
#[cfg(test)]
mod tests;

pub use edge_tree::{EdgeLeaf, EdgeTree, EdgeTreeCounts};
pub use rule::PmRule;

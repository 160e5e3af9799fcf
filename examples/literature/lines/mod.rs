//! Trees of lines in memory, as the literature describes them: the PM quadtrees of polygonal maps (Samet and Webber 1985), their variant with buckets, quadtrees
//! of pixels that lines pass through, and the same in space, where the first rule makes the octree of edges.
//!
//! Blocks are half-open: they have their least sides, and not their greatest ones. So each vertex is in one leaf alone, also on a line that divides; an edge along
//! such a line is in the blocks on its far side. (With closed blocks a vertex on a dividing line would be in two or four leaves, and edges that end there would be neighbours of
//! others that they have nothing to do with.) Whether an edge passes through a block is decided in whole numbers. All rules hold for some edges if they hold for more: so
//! a tree follows from its edges alone, in whatever order they came.

mod clip;
mod distance;
mod edge_tree;
mod rule;
#[cfg(test)]
mod tests;

pub(crate) use edge_tree::{EdgeLeaf, EdgeTree};
pub(crate) use rule::PmRule;

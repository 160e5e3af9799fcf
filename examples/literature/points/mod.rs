//! In-memory point trees from the literature: the point quadtree (Finkel and Bentley 1974), which
//! divides at its points, and the halving trees.
//!
//! Slavík's survey says that the point quadtree has the same properties as an ordinary quadtree. It
//! has not: its blocks are of any size, so that trees of other points have other blocks; it depends
//! on the order of insertion; and equal subtrees cannot be merged. The halving tree has these
//! properties.

mod halving;
mod point_quadtree;

pub(crate) use halving::HalvingTree;
pub(crate) use point_quadtree::PointQuadtree;

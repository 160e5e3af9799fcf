//! Trees of points in memory, as the literature describes them: the point quadtree (Finkel and Bentley 1974), whose lines go through its points, and
//! the ones that halve.
//!
//! Slavík's survey says of the point quadtree that it has the same properties as an ordinary quadtree. It has not: its blocks are of any size, so that trees of other points do
//! not lie on each other, it depends on the order in which the points came, and what is equal below cannot be merged. The halving tree has these properties.

mod halving;
mod point_quadtree;

pub(crate) use halving::HalvingTree;
pub(crate) use point_quadtree::PointQuadtree;

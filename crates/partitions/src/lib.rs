//! Structures of the literature in memory: bintrees, which halve blocks of cells; BSP trees, which
//! divide along arbitrary lines or planes; PM quadtrees and octrees of edges; and trees that are
//! divided at their points.
//!
//! The first two are in preorder ([`preorder`]): a node, then its first side, then its second side.

pub mod bintree;
pub mod bsp;
pub mod divided_points;
pub mod edges;
pub mod preorder;

//! Binary space partitions: bintrees, which halve blocks of cells, and BSP trees, which divide
//! along arbitrary lines or planes.
//!
//! Both are in memory in preorder ([`preorder`]): a node, then its first side, then its second
//! side.

pub mod bintree;
pub mod bsp;
pub mod preorder;

//! Trees that divide space in two, node by node: bintrees, which halve blocks of cells, and BSP trees, which divide along any line or plane.
//!
//! Both stand in memory in preorder ([`preorder`]): a node, what is on its first side, and then what is on its second.

pub mod bintree;
pub mod bsp;
pub mod preorder;

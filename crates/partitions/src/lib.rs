//! Structures of the literature in memory: bintrees, which halve blocks of cells; BSP trees, which
//! divide along arbitrary lines or planes; PM quadtrees and octrees of edges; and trees that are
//! divided at their points.
//!
//! The first two are in preorder ([`preorder`]): a node, then its first side, then its second side.

pub mod bintree;
pub mod bsp;
mod cell_head;
mod df_text;
pub mod divided_points;
pub mod edges;
mod extended_octree;
pub mod preorder;
mod solid_text;
mod text_file;

pub use df_text::{DfText, df_head};
pub use extended_octree::extended_octree_text;
pub use solid_text::SolidText;

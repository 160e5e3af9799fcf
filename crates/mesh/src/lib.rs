//! Mesh import and export: solids and exact models from meshes, surfaces of trees and models, glTF
//! and 3D Tiles.

pub mod export;
pub mod import;
#[cfg(feature = "meshopt")]
mod levels;

#[cfg(feature = "meshopt")]
pub use levels::{add_levels, with_levels};

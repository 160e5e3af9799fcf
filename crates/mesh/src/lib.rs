//! Meshes in and out: solids and exact models made of them, surfaces of trees and models, glTF and 3D Tiles.

pub mod export;
pub mod import;

//! Readers of numeric record formats of other programs: NPY, PLY and plain text. They decode
//! headers and numbers. Other crates build rasters, meshes and points from these.

pub mod npy;
pub mod ply;
pub mod text;

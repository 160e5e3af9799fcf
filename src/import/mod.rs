//! Importers: what turns other programs' files into sources and blocks of samples.

pub mod cells;
#[cfg(any(feature = "mesh", feature = "raster"))]
mod guard;
#[cfg(feature = "mesh")]
pub mod mesh;
#[cfg(feature = "raster")]
pub mod raster;

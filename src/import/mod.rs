//! Importers: readers of other programs' files, as sources and blocks of samples.

pub mod cells;
pub mod geojson;
#[cfg(any(feature = "mesh", feature = "raster"))]
mod guard;
#[cfg(feature = "mesh")]
pub mod mesh;
mod npy;
#[cfg(feature = "raster")]
pub mod raster;
#[cfg(feature = "raster")]
pub mod volume;

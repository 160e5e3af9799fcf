//! Triangulated surfaces of features: as rasters, and as layers of exact models.

mod boreholes;
mod isolines;
mod raster;
mod read;

pub use boreholes::{BoreholeAttributes, BoreholeReport};
pub use isolines::export_isolines;
pub use raster::{SurfaceRaster, read_heights, write_surface};
pub use read::{SurfaceFiles, SurfacePoints, read_surfaces};

//! Features in and out: points, lines, polygons with holes.

pub mod export;
pub mod import;
pub mod objects;
pub mod overlay;
mod point_raster;
mod surfaces;
pub mod zonal;

pub use point_raster::{CellRule, PointRaster, rasterize_points};
pub use surfaces::{
    SurfaceFiles, SurfacePoints, export_isolines, read_heights, read_surfaces, write_surface,
};

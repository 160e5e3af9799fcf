//! Features in and out: points, lines, polygons with holes.

pub mod export;
pub mod import;
pub mod objects;
pub mod overlay;
mod point_raster;
pub mod zonal;

pub use point_raster::{CellRule, PointRaster, rasterize_points};

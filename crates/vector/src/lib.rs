//! Features in and out: points, lines, polygons with holes.

pub mod export;
pub mod import;
mod line_tree;
pub mod objects;
pub mod overlay;
mod point_raster;
pub mod zonal;

pub use line_tree::{JoinSummary, export_lines, join_nearest_lines};
pub use point_raster::{CellRule, PointRaster, rasterize_points};

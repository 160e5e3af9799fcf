//! Import and export of vector features: points, lines, polygons with holes.

mod body_values;
pub mod export;
pub mod import;
mod line_tree;
pub mod objects;
pub mod overlay;
mod point_raster;
mod reproject;
mod surfaces;
mod within;
pub mod zonal;

pub use body_values::{BodySamples, BodyValueOptions, build_body_values, read_samples};
pub use line_tree::{CrossingSummary, JoinSummary, export_lines, join_crossing_lines, join_nearest_lines};
pub use point_raster::{CellRule, PointRaster, rasterize_points};
pub use reproject::{ReprojectOptions, SystemChange, reproject_features};
pub use surfaces::{
    BoreholeAttributes, BoreholeReport, SurfaceFiles, SurfacePoints, SurfaceRaster, export_isolines,
    read_heights, read_surfaces, write_surface,
};
pub use within::region_of_polygons;

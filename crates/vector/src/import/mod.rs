//! Readers of features.

mod csv;
mod dbf;
mod encoding;
pub mod feature;
pub mod filter;
#[cfg(feature = "flatgeobuf")]
mod flatgeobuf;
mod formats;
mod geojson;
#[cfg(feature = "geopackage")]
mod geopackage;
mod heights;
mod lines;
mod points;
pub mod rasterize;
mod rings;
mod rows;
mod scanner;
mod shapefile;
mod sidecar;
mod wkb;
mod wkt;
pub mod zones;

pub use lines::{FeatureLines, open_feature_lines};
pub use points::plan_point_files;

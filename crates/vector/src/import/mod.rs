//! Readers of features.

pub mod feature;
pub mod filter;
mod formats;
mod geojson;
pub mod rasterize;
mod scanner;
pub mod zones;

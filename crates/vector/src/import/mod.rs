//! Readers of features.

pub mod feature;
pub mod filter;
mod formats;
mod geojson;
mod scanner;
pub mod zones;

//! Readers of features.

pub mod geojson;

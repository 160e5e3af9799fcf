//! Exporters: trees as other programs' files.

#[cfg(feature = "raster")]
pub mod image;

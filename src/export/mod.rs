//! Exporters: trees as other programs' files.

#[cfg(feature = "raster")]
pub mod image;

#[cfg(feature = "mesh")]
pub mod mesh;

#[cfg(feature = "raster")]
mod window;

#[cfg(feature = "raster")]
pub use window::{Detail, WindowRequest, export_window, fill_for};

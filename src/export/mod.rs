//! Exporters: trees as other programs' files.

#[cfg(feature = "raster")]
mod array;
#[cfg(feature = "raster")]
mod camera;
#[cfg(feature = "raster")]
mod cog;
#[cfg(feature = "raster")]
pub mod image;
#[cfg(feature = "raster")]
mod legend;
#[cfg(feature = "mesh")]
pub mod mesh;
#[cfg(feature = "raster")]
mod paint;
#[cfg(feature = "raster")]
mod render;
mod spill;
#[cfg(feature = "raster")]
pub mod tiles;
pub mod vector;
#[cfg(feature = "raster")]
mod window;

#[cfg(feature = "raster")]
pub use array::{ArrayRequest, export_array};
#[cfg(feature = "raster")]
pub use camera::Projection;
#[cfg(feature = "raster")]
pub use cog::{CogCompression, CogRequest, CogSummary, export_cog};
#[cfg(feature = "raster")]
pub use legend::{LegendFormat, export_legend};
#[cfg(all(feature = "raster", feature = "mesh"))]
pub use render::render_exact;
#[cfg(feature = "raster")]
pub use render::{RenderRequest, render};
#[cfg(feature = "raster")]
pub use window::{Detail, TakeRows, WindowRequest, export_window, fill_for, void_number, window_rows};

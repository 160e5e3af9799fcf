//! Import and export. Reads raster images, volumes, chain codes and cell lists; writes images,
//! arrays, chain codes, tile archives and cloud-optimized GeoTIFF.

mod array;
pub mod cells;
mod chain_code;
mod cog;
pub mod image;
pub mod import;
pub mod index;
mod legend;
pub mod tile_archives;
pub mod volume;
mod window;

pub use array::{ArrayRequest, export_array};
pub use chain_code::{ChainDirections, ChainWriter, export_chain_code};
pub use cog::{CogCompression, CogRequest, CogSummary, export_cog};
pub use legend::{LegendFormat, export_legend};
pub use window::{
    Detail, RowSink, WindowRequest, export_layers, export_painted_window, export_window, void_number,
    window_rows,
};

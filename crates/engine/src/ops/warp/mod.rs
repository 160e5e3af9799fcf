//! Warping: a raster tree resampled to the grid of another coordinate system.
//!
//! [`Warped`] is a tree over a given grid, computed from a file on any other grid. Like a view, it
//! computes blocks on request. Where the file is uniform, blocks are settled without reading cells.
//!
//! 1. `spinney_crs` parses and validates coordinate systems, and transforms longitudes and
//!    latitudes. It rejects systems that it cannot compute as PROJ does.
//! 2. `mapping.rs` chains frames and the transformation between systems into a map from target
//!    cells to source cells. `grid.rs` fits a grid to the area where data land (`landing.rs`).
//!    `lattice.rs` maps all points of a block: by columns and rows if these are independent, else
//!    by polynomials of degree two, which are checked against the exact map on ever smaller
//!    rectangles.
//! 3. `source.rs` is the tree over the target grid, and a source for views (`view_source.rs`). A
//!    node with a uniform image is settled (`uniform.rs` checks the file's nodes along its edges).
//!    Blocks of 256 x 256 cells read a window of the source (`window.rs`, also across the
//!    antimeridian) and resample it (`nearest.rs`, `interpolate.rs`, `area.rs`).
//! 4. An importer that reprojects builds the raster's own tree in a temporary file first, so that
//!    input may arrive in any order, and warps that. An export to tiles has one warped tree per
//!    zoom, which reads the coarsest sufficient level of the source.

mod area;
mod average;
mod build;
mod grid;
mod interpolate;
mod landing;
mod lattice;
mod mapping;
mod nearest;
mod options;
mod samples;
mod source;
mod uniform;
mod window;

#[cfg(test)]
mod tests;

pub use build::warp;
pub(super) use grid::landing_in_cells;
pub use grid::{MAX_ZOOM, WarpTarget};
pub use options::{Resampling, WarpOptions};
pub use source::{WarpGrid, Warped};

//! Warping: a raster tree seen on the cells of another coordinate system.
//!
//! [`Warped`] is a tree over the grid that is asked for, made of a file on any other grid. Like a view it computes what somebody
//! asks for, block by block; where the file is alike all over, blocks are settled without looking at cells.

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

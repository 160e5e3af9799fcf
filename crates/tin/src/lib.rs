//! Triangulated irregular networks (TIN): surfaces over the plane.
//!
//! They are made from scattered points with breaklines and outlines, or from rasters within a
//! maximum error, and can be converted back to rasters. Isolines can be traced on them, and the
//! layers between several surfaces become exact models.

mod greedy;
mod grid;
mod isolines;
mod layers;
mod mesh;
mod overlap;
mod smooth;
mod stack;
mod surface;
#[cfg(test)]
mod tests;
mod tin;

pub use greedy::approximate;
pub use grid::HeightGrid;
pub use isolines::Isoline;
pub use layers::{LayerInput, LayerMeasure, LayerOptions, LayerReport, LayerSurface, build_layers};
pub use smooth::Smoothing;
pub use stack::{OrderedSurfaces, order_surfaces};
pub use surface::{Duplicates, SurfaceInput, SurfaceReport, triangulate};
pub use tin::Tin;

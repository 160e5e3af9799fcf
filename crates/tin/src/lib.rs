//! Surfaces over the plane as triangulated irregular networks (TIN): of scattered points with breaklines and outlines, of rasters within an
//! error, and back; isolines; and the closed bodies between several surfaces as exact models.

mod greedy;
mod grid;
mod isolines;
mod layers;
mod mesh;
mod smooth;
mod surface;
#[cfg(test)]
mod tests;
mod tin;

pub use greedy::approximate;
pub use grid::HeightGrid;
pub use isolines::Isoline;
pub use layers::{LayerInput, LayerMeasure, LayerOptions, LayerReport, LayerSurface, build_layers};
pub use surface::{Duplicates, SurfaceInput, SurfaceReport, triangulate};
pub use tin::Tin;

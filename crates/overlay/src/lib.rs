//! Exact overlay of polygons in the plane: [`PolygonOverlay`] divides the plane along the edges of
//! all polygons and reports, for each region, which polygons cover it.
//!
//! Input coordinates are doubles, and every predicate is exact on them. Output coordinates lie on a
//! given grid. Edges are split where they cross, and vertices and crossings move to the centres of
//! their grid cells by snap rounding (J. Hobby, *Practical segment intersection with finite
//! precision output*, 1999). Snap rounding introduces no new crossings. No point moves by more than
//! half a cell along either axis.
//!
//! 1. [`PolygonOverlay::add`] collects the rings' edges. Each edge is stored once, with the
//!    polygons that it bounds (`edges.rs`).
//! 2. `crossings.rs` finds the grid cells in which edges cross. `passages.rs` finds the edges that
//!    pass through cells with vertices or crossings. Both descend a quadtree of the cells and use
//!    the predicates of `exact.rs`.
//! 3. `sweep.rs` sweeps the split edges from left to right and computes the set of polygons on each
//!    side of every edge (`sets.rs`).
//! 4. `rings.rs` assembles polygons from the edges that separate requested regions.
//!
//! [`Polygon`] computes the raster cells that a polygon covers (`polygon/`). It uses the overlay
//! for polygons whose rings cross.

mod chords;
mod crossings;
mod edges;
mod exact;
mod grid;
mod memory_limit;
mod overlay;
mod passages;
mod polygon;
mod rings;
mod sets;
mod sweep;
#[cfg(test)]
mod tests;

pub use grid::OverlayGrid;
pub use overlay::{OverlayRegion, OverlaySummary, PolygonOverlay};
pub use polygon::{Crossings, FULL_SHARE, OrientedRings, Polygon, oriented_rings};

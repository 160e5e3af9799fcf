//! PolygonOverlay of polygons in the plane: into which parts the edges of all divide it, and which polygons each part is in.
//!
//! Coordinates are doubles, and all decisions are exact on them. What comes out lies on a grid that is stated: edges are divided where they cross, and
//! corners and crossings go to the middles of their cells by snap rounding (J. Hobby, *Practical segment intersection with finite precision output*,
//! 1999), which lets no two edges cross that did not. No point moves by more than half of a cell along either axis.
//!
//! 1. [`PolygonOverlay::add`] takes rings: their edges, each once, with the parts that it is an edge of (`edges.rs`).
//! 2. `crossings.rs` finds the cells of the grid in which edges cross, `passages.rs` the cells with corners or crossings that edges pass: both go down
//!    a quadtree of the cells. `exact.rs` has what decides.
//! 3. `sweep.rs` goes over the edges that this makes from left to right, and tells what is on both of their sides (`sets.rs`).
//! 4. `rings.rs` makes polygons of the edges that divide what is asked for.
//!
//! And [`Polygon`]: the cells of a raster that a polygon covers (`polygon/`), which overlays polygons whose rings cross.

mod chords;
mod crossings;
mod edges;
mod exact;
mod grid;
mod overlay;
mod passages;
mod polygon;
mod rings;
mod room;
mod sets;
mod sweep;
#[cfg(test)]
mod tests;

pub use grid::OverlayGrid;
pub use overlay::{OverlayPart, OverlaySummary, PolygonOverlay};
pub use polygon::{Crossings, FULL_SHARE, OrientedRings, Polygon, oriented_rings};

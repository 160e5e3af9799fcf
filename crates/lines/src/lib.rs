//! On-disk quadtrees and octrees of lines, in the plane or in space: the lines of any number of
//! features in one file, indexed by position, with the features' attributes.
//!
//! The unit of storage is a line segment between two consecutive vertices of a line. Each is stored
//! exactly once, unclipped, in the deepest node that is no smaller than the segment and contains
//! its midpoint; subtrees with few segments are merged into one leaf. So queries need no
//! deduplication, the file does not grow if long segments cross many nodes, and short segments are
//! not stored near the root because they happen to cross a dividing line. A segment may extend
//! beyond its node, so nodes and blocks store the bounds of their segments.
//!
//! Positions have three coordinates everywhere. In a tree of two axes, z is 0 and is not stored. z
//! is NaN in positions of queries that have no height: these are compared in x and y.

mod attribute;
mod build;
mod codec;
mod geometry;
mod grid;
mod query;
mod source;
mod statistics;
mod store;
#[cfg(test)]
mod tests;
mod vertex_grid;

pub use attribute::{LineAttribute, LineValue, ValueKind};
pub use build::{LineBuildOptions, LineBuildSummary, build};
pub use grid::LineGrid;
pub use query::{LevelTotals, LineCrossing, NearLine, NearestLines};
pub use source::{LineFeature, LineSchema, LineSource, LinesInMemory};
pub use store::{LineTree, is_line_file};
pub use vertex_grid::{ROUNDED, VertexGrid, VertexSurvey};

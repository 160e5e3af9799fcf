//! Quadtrees of lines on disk: the lines of any number of features in one file, found by where they pass, with the features' attributes.
//!
//! Each piece of a line between two of its vertices is there once, whole: in the deepest node that is no smaller than it and has its middle. So no answer needs
//! to be freed of repetitions, bytes do not grow where a long piece passes through many squares, and short pieces are not kept near the root because a dividing
//! line happens to cross them. Nodes and blocks say how far what is in them reaches.

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

pub use attribute::{LineAttribute, LineValue, ValueKind};
pub use build::{LineBuildOptions, LineBuildSummary, build};
pub use grid::LineGrid;
pub use query::{LevelTotals, LineCrossing, NearLine, NearestLines};
pub use source::{LineFeature, LineSchema, LineSource, LinesInMemory};
pub use store::{LineTree, is_line_file};

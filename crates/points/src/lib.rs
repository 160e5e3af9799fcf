//! Point octrees and quadtrees on disk. One file holds any number of points at all levels of
//! detail, and queries read that file directly.
//!
//! Each point is stored once, in the coarsest node whose point spacing it keeps. Reading down to a
//! level yields evenly spread points; each deeper level adds points and repeats none. Attributes
//! are compressed column by column. Each node stores counts, extremes and sums.

mod attribute;
mod build;
mod codec;
mod export;
mod grid;
mod import;
pub mod las;
mod query;
pub mod shard;
mod source;
mod statistics;
mod store;
mod tables;
#[cfg(test)]
mod tests;

pub use attribute::{POSITION_BYTES, PointAttribute, RowField, RowLayout, ordered_number};
pub use build::{BuildSummary, PointBuildOptions, build};
pub use export::{PointFormat, export_points};
pub use grid::PointGrid;
pub use import::{
    PointImport, PointImportOptions, attribute_index, has_points, is_las_file, plan_files, plan_points,
};
pub use query::{
    ColumnSummary, NearPoint, PointColumns, PointCondition, PointIndex, PointRegion, PointStatistics,
    Relation, Selection,
};
pub use source::{
    ChosenPoints, GriddedPoints, PointRows, PointSchema, PointSource, PointSubset, WorldPoints,
};
pub use store::{PointTree, is_point_file};

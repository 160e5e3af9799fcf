//! Octrees and quadtrees of points on disk: any number of points in one file with every level of detail inside, and answers straight from
//! that file.
//!
//! Each point is there once, in the coarsest node whose spacing it keeps: who reads down to a level gets points that are spread evenly, and each
//! deeper level adds some, and repeats none. Attributes are packed, column by column; counts, extremes and sums stand by each node.

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
    PointImport, PointImportOptions, has_points, is_las_file, plan_files, plan_points, position,
};
pub use query::{
    ColumnSummary, NearPoint, PointColumns, PointCondition, PointRegion, PointStatistics, Relation, Selection,
};
pub use source::{ChosenPoints, GriddedPoints, PointPart, PointRows, PointSchema, PointSource, WorldPoints};
pub use store::{PointTree, is_point_file};

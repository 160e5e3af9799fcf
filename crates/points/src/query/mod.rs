//! Queries of point trees.

mod block_index;
mod condition;
mod nearest;
mod point_index;
mod region;
mod select;

pub use condition::{PointCondition, Relation};
pub use nearest::NearPoint;
pub use point_index::PointIndex;
pub use region::PointRegion;
pub use select::{ColumnSummary, PointColumns, PointStatistics, Selection};

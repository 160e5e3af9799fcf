//! Questions about trees of points.

mod condition;
mod region;
mod select;

pub use condition::{PointCondition, PointRelation};
pub use region::PointRegion;
pub use select::{ColumnSummary, PointColumns, PointStatistics, Selection};

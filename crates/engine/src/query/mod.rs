//! Queries on trees: cells, windows at any level, statistics and searches; for solids, measures and
//! rays.
//!
//! Each query works on any [`Source`](crate::tree::Source). File formats that support it have a
//! faster implementation.

pub mod cell_blocks;
mod classes;
mod contours;
mod count;
pub mod dump;
mod field;
mod find;
mod folded;
mod histogram;
mod neighbourhood;
mod occupancy;
mod pixels;
mod points;
mod polygonize;
mod ray;
mod solid;
mod stats;
mod surface;
mod walk;
mod window;
mod world_bounds;
mod zonal;

pub(crate) use contours::ContourGround;
pub use contours::{Contour, ContourEnds, ContourLevels, ContourRequest, ContourSummary, ContourVisitor};
pub use contours::{Extremes, Relief};
pub use contours::{Levels, level_share};
pub(crate) use contours::{file_extremes, source_extremes, trace_contours};
pub use field::Field;
pub(crate) use find::source_find;
pub use find::{Condition, FoundBlock};
pub(crate) use histogram::{autumnal_histogram, source_histogram};
pub(crate) use occupancy::{Filling, HALF, OccupancyLevel};
pub use pixels::PixelGrid;
pub(crate) use pixels::PixelSums;
pub use points::PointSamples;
pub(crate) use points::values_one_by_one;
pub(crate) use polygonize::{ClassCells, ClassGrid, find_regions};
pub use polygonize::{ClassRegion, PolygonRequest, PolygonSummary, RegionVisitor};
pub use ray::{CellHit, Ray, Rays, SurfaceHit};
pub use solid::SolidStatistics;
pub(crate) use solid::measure;
pub use stats::{ChannelStatistics, Statistics};
pub(crate) use stats::{autumnal_statistics, source_statistics, tally_of};
pub use surface::SolidSurface;
pub(crate) use surface::measure_surface;
pub use window::Canvas;
pub use window::StoredRows;
pub(crate) use zonal::{ZonalGroup, ZonalTree, zonal};
pub use zonal::{ZonalRequest, ZoneChannel, ZoneMeasure, ZoneStatistics, ZoneValues};

use spinney_base::{Error, Result};

/// Fails if a tree of `depth` levels has no such level.
pub fn check_level(level: u8, depth: u8) -> Result<()> {
    if level > depth {
        return Err(Error::invalid("level", level.to_string(), format!("0 to {depth}")));
    }
    Ok(())
}

//! Questions to trees on disk: cells, windows at any level, statistics, searches; of solids measures and rays.

mod any;
pub mod cell_blocks;
pub(crate) mod dump;
mod field;
mod file;
mod find;
mod occupancy;
mod points;
mod ray;
mod solid;
mod stats;
mod walk;
mod window;

pub use any::{Tree, open};
pub(crate) use field::Field;
pub(crate) use file::{as_tree, octree};
pub(crate) use find::source_find;
pub use find::{Condition, FoundBlock};
pub(crate) use occupancy::{Filling, Level};
pub use points::{PointSamples, Points};
pub use ray::{CellHit, Ray, Rays, SurfaceHit};
pub use solid::SolidStatistics;
pub(crate) use solid::measure;
pub use stats::{ChannelStatistics, Statistics};
pub(crate) use stats::{source_histogram, source_statistics};
pub(crate) use walk::node_bounds;
pub(crate) use window::{Canvas, fill_value, wires_of};

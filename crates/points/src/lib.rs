//! Trees of points.

mod attribute;
mod build;
mod codec;
mod grid;
pub mod las;
mod source;
mod statistics;
mod store;

pub use attribute::{Attribute, Field, PLACE_BYTES, RowLayout};
pub use build::{BuildOptions, BuildSummary, build};
pub use grid::PointGrid;
pub use source::{PointSchema, PointSource};

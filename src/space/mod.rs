//! Space: dimensions, nodes' codes, regions of cells, and where the cells lie in the world.

mod bounds;
mod code;
mod control_points;
mod crs;
mod dimension;
mod frame;
mod polygon;
mod projection;
mod region;
mod up;
mod web_mercator;

pub use bounds::Bounds;
pub(crate) use code::morton_encode;
pub use code::{Cell, Code};
pub use control_points::{ControlPoint, ControlPoints};
pub use crs::{Crs, Epsg, GeoKeys};
pub use dimension::Dimension;
pub use frame::Frame;
pub use polygon::{Cover, Polygon};
pub use projection::{PROJECTION_METHODS, Projection};
pub use region::Region;
pub use up::Up;
pub use web_mercator::{
    WEB_MERCATOR, WEB_MERCATOR_HALF, WEB_MERCATOR_LATITUDE, web_mercator, web_mercator_depth,
};

//! Where cells lie in the world: coordinate systems as they were defined, their formulas, and the frames that lead to them.

mod control_points;
mod definition;
mod frame;
mod projection;
mod web_mercator;

pub use control_points::{ControlPoint, ControlPoints};
pub use definition::{Crs, Epsg, GeoKeys};
pub use frame::Frame;
pub use projection::{PROJECTION_METHODS, Projection};
pub use web_mercator::{
    WEB_MERCATOR, WEB_MERCATOR_HALF, WEB_MERCATOR_LATITUDE, web_mercator, web_mercator_depth,
};

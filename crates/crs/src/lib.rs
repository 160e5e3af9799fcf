//! Georeferencing: coordinate reference systems in their original definitions, their projections,
//! and the frames that map cells to them.

mod cell_locator;
mod control_points;
mod coordinates;
mod definition;
mod exchange;
mod frame;
mod methods;
mod projection;
mod registry;
mod transformation;
mod web_mercator;
mod world_locator;

pub use cell_locator::{CellLocator, PolygonParts, corners_text};
pub use control_points::{ControlPoint, ControlPoints};
pub use coordinates::Coordinates;
pub use definition::{Crs, Epsg, GeoKeys};
pub use frame::Frame;
pub use projection::{AreaOfUse, PROJECTION_METHODS, Projection};
pub use transformation::Transformation;
pub use web_mercator::{
    WEB_MERCATOR, WEB_MERCATOR_HALF, WEB_MERCATOR_LATITUDE, web_mercator, web_mercator_depth,
};
pub use world_locator::WorldLocator;

//! Space: dimensions, nodes' codes, regions of cells, and where the cells lie in the world.

mod bounds;
mod code;
mod control_points;
mod dimension;
mod epsg;
mod frame;
mod region;
mod up;

pub use bounds::Bounds;
pub(crate) use code::morton_encode;
pub use code::{Cell, Code};
pub use control_points::{ControlPoint, ControlPoints};
pub use dimension::Dimension;
pub use epsg::is_geographic;
pub use frame::Frame;
pub use region::Region;
pub use up::Up;

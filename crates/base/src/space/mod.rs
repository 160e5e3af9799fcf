//! Space: dimensions, node codes, and regions of cells.

mod bounds;
mod code;
mod code_range;
mod coordinate_axis;
mod cover;
mod dimension;
mod edge;
mod region;
mod up;

pub use bounds::Bounds;
pub use code::{Cell, Code, morton_encode};
pub use code_range::CodeRange;
pub use coordinate_axis::{AxisGrid, CoordinateAxis};
pub use cover::Cover;
pub use dimension::Dimension;
pub use edge::EdgeRule;
pub use region::Region;
pub use up::Up;

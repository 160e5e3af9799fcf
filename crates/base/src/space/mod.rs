//! Space: dimensions, nodes' codes, regions of cells.

mod bounds;
mod code;
mod code_run;
mod dimension;
mod edge;
mod polygon;
mod region;
mod up;

pub use bounds::Bounds;
pub use code::{Cell, Code, morton_encode};
pub use code_run::CodeRun;
pub use dimension::Dimension;
pub use edge::EdgeRule;
pub use polygon::{Cover, Crossings, Polygon};
pub use region::Region;
pub use up::Up;

//! Affine views of trees: one map between the cells of a result and those of a file, for any number
//! of chained operations.

mod area;
mod classify;
mod draw;
mod level;
mod map;
mod polyhedron;
mod view;

pub use classify::{Around, ViewNode};
pub use map::{AffineMap, Axis};
pub use view::{Sampling, View};

//! Exact models: boundary representations on an integer grid, kept as they are and not as cells.

pub(crate) mod arrangement;
pub(crate) mod attributes;
mod boxes;
mod build;
mod combine;
mod face;
mod grid;
mod hash;
mod piece;
pub(crate) mod planar;
pub mod questions;
mod store;
pub mod surface_intersection;
pub mod topology;
mod triangulated;

pub use attributes::Attributes;
pub(crate) use build::show_place;
pub use build::{BOOLEAN_FACES, BuildReport, Defect, DefectKind, ModelBuilder};
pub use combine::{CombineReport, combine};
pub use face::{Face, FaceList, Faces};
pub use grid::{Grid, MOST_BITS};
pub use store::{ExactModel, FaceBuffer, Node, NodeCounts, NodeKind, NodeState, Rule, is_model_file};
pub use triangulated::Triangulated;

//! Exact models: boundary representations on an integer grid, stored as faces and not as cells.

mod arrangement;
pub mod attributes;
mod body_check;
mod boxes;
mod build;
mod chosen_parts;
mod closure;
mod combine;
mod curve;
mod equal_faces;
pub mod euler;
pub mod exact;
mod face;
mod face_check;
mod face_order;
mod face_set;
mod face_triangle;
pub mod geometry;
mod grid;
mod hash;
mod levels;
mod motion;
mod object_contacts;
mod part_sums;
pub mod planar;
pub mod query;
mod repair;
mod store;
pub mod surface_intersection;
pub mod topology;
mod triangulated;

pub use arrangement::{ExactPlane, ExactPoint, UnitedVertex, unite_facets};
pub use attributes::Attributes;
pub use body_check::body_flaw;
pub use build::format_position;
pub use build::{BuildReport, ColumnValues, Defect, DefectKind, LEAF_SIZE, ModelBuilder};
pub use chosen_parts::ChosenParts;
pub use combine::{
    BoundaryClass, CombineReport, NodePair, OperandKind, Origin, TableEntry, boundary_classes, combine,
    combine_as, combine_explained, divide_faces,
};
pub use exact::bounds::MAX_BITS;
pub use face::{AttributedFaceVisitor, Face, FaceList, Faces};
pub use face_order::FaceSorter;
pub use grid::Grid;
pub use levels::{Simplifier, add_levels};
pub use motion::{ModelView, Motion, TransformOptions, TransformReport, ViewRays, transform};
pub use object_contacts::{ContactKind, ContactVisitor, ObjectContact, object_contacts};
pub use repair::{InsideRule, REPAIR_PASSES, Repair, RepairInput};
pub use store::{
    DetailLevel, ExactModel, FaceBuffer, LeafRule, ModelNode, ModelNodeState, NodeCounts, NodeKind,
    is_model_file,
};
pub use triangulated::{Triangulated, each_triangle};

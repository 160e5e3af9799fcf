//! Reconstruction of solids as octrees: carved by images from known directions, or interpolated
//! between outlines at given heights.

mod linear;
mod outlines;
mod plan;
mod source;
mod views;

pub use outlines::plan_outlines;
pub use plan::ReconstructionImport;
pub use views::{is_views_name, plan_views};

//! Solids of what was seen of them: octrees that are carved by pictures from known directions, and of outlines at heights.

mod linear;
mod outlines;
mod plan;
mod source;
mod views;

pub use outlines::plan_outlines;
pub use plan::ReconstructionImport;
pub use views::{is_views_name, plan_views};

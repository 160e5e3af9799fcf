//! Solids from models: vertices are snapped to a grid, triangles become a source, and the source
//! becomes a tree.

mod bits;
mod boundary;
mod build;
pub(super) mod closure;
mod coverage;
mod cubic;
mod face_sums;
mod field;
mod fill;
mod grid;
mod inside;
mod local;
mod nearest;
mod octants;
mod open;
mod plan;
mod rim;
mod source;
mod surroundings;
mod survey;
#[cfg(test)]
mod tests;
mod triangles;
mod union;
mod units;
mod volume;
mod windings;

pub(super) use build::provenance;
pub use build::{InsideTest, SolidReport};
pub use inside::Attribute;
pub use plan::{DEFAULT_MEMORY, FittedCells, Resolution, SolidImport, SolidOptions, fit_cells, plan_models};
pub(super) use plan::{bounds, common_crs, flat_faces};
pub use survey::{SolidSurvey, SurfaceAtPoint, SurveyedNode, plan_part};
pub(super) use volume::{CellVolume, ChosenParts, cell_volume};

//! Importers of solids: boundary representations, read face by face, become octrees.

mod face;
mod model;
mod read;
mod solid;

pub use face::{Box3, Flaw, Polygon, Stage, Stages, Triangulator, Verdict};
pub use model::{Face, Model, ModelInfo};
pub use read::{is_model, open, open_all};
pub use solid::{
    Attribute, Boundary, DEFAULT_MEMORY, Decided, Resolution, SolidImport, SolidOptions, SolidReport,
    plan_models,
};

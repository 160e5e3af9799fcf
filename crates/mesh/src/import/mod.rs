//! Solid importers: boundary representations are read face by face and become octrees of cells or
//! exact models.

mod edges;
mod exact;
mod model;
mod read;
mod solid;

pub use edges::{EdgeOptions, MeshEdges, open_mesh_edges};
pub use exact::{ExactOptions, ExactReport, ModelContact, SkippedObject, import_exact, model_contacts};
pub use model::{MeshFace, Model, ModelInfo, parts_of};
pub(crate) use read::{MATERIAL, MAX_LIBRARY_BYTES, city_semantics};
pub use read::{MeshArrays, MeshColours, files_of, is_model, open, open_all, open_all_with, open_with};
pub use solid::{
    Attribute, DEFAULT_MEMORY, FittedCells, InsideTest, Resolution, SolidImport, SolidOptions, SolidReport,
    SolidSurvey, SurfaceAtPoint, SurveyedNode, fit_cells, plan_models, plan_part,
};

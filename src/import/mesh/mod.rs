//! Importers of solids: boundary representations, read face by face.

mod model;

pub use model::{Face, Model, ModelInfo};

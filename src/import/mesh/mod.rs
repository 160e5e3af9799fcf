//! Importers of solids: boundary representations, read face by face.

mod model;
#[cfg_attr(not(test), expect(dead_code, reason = "what asks follows"))]
mod triangle;

pub use model::{Face, Model, ModelInfo};

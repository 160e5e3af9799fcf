//! Manifests: texts (JSON) that tell many files as one, with all that opening them would tell, so that a question opens those it touches.

mod document;
mod listed_file;
mod manifest;

pub use listed_file::{FileTag, ListedFile};
pub use manifest::{Manifest, is_manifest, is_manifest_file};

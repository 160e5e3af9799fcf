//! Manifests: texts (JSON) that tell many files as one, with all that opening them would tell, so that a question opens those it touches.

mod document;
mod entry;
mod manifest;

pub use entry::{Entry, FileTag};
pub use manifest::{Manifest, is_manifest, is_manifest_file};

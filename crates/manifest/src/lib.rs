//! Manifests: JSON files that describe many tree files as one.
//!
//! A manifest stores what opening the files would yield, so that a query opens only the files that
//! it needs.

mod document;
mod listed_file;
mod manifest;

pub use listed_file::{FileTag, ListedFile};
pub use manifest::{Manifest, is_manifest, is_manifest_file};

//! Trees as inputs.

use std::path::{Path, PathBuf};

use spinney_base::Result;
use spinney_base::io::FileAccess;
use spinney_container::FileReference;
use spinney_engine::ops::Outcome;
use spinney_manifest::{Manifest, is_manifest_file};

/// Bytes of memory for writing files without cells.
pub(super) const LITTLE: u64 = 1 << 20;

/// Files that reading a tree involves: its own, and those that a manifest lists.
pub(super) fn files_of(input: &Path, access: &FileAccess) -> Result<Vec<PathBuf>> {
    let file = FileReference::of(input).file.into_owned();
    if !is_manifest_file(&file, access)? {
        return Ok(vec![file]);
    }
    let listed = Manifest::open(&file, access)?.entries;
    let listed = listed.iter().map(|listed| listed.file(&file)).collect::<Result<Vec<_>>>()?;
    Ok([vec![file], listed].concat())
}

/// Short description of the result.
pub(super) fn description(outcome: &Outcome) -> Vec<(&'static str, String)> {
    let [width, height, depth] = outcome.extent;
    let size =
        if depth > 1 { format!("{width} x {height} x {depth}") } else { format!("{width} x {height}") };
    vec![("size", format!("{size} cells, depth {}", outcome.depth))]
}

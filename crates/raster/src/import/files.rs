//! Lists the files that reading a raster may access.

use std::path::{Path, PathBuf};

use super::{RasterOptions, mask_file, open_input, vrt, worldfile};
use spinney_base::Result;
use spinney_base::io::{sibling_path, sidecar_of};

/// Returns all files that reading a raster may access, whether they exist or not: the file, its
/// possible sidecars, and the same for the sources of a virtual raster.
///
/// # Errors
/// If the file, or a source, cannot be read.
pub fn files_of(path: &Path, options: &RasterOptions) -> Result<Vec<PathBuf>> {
    let mut files = vec![path.to_path_buf(), sibling_path(path, sidecar_of), mask_file::mask_of(path)];
    files.extend(worldfile::candidates(path));
    files.extend(worldfile::prj_files(path));
    if vrt::is_vrt(&open_input(path, &options.access)?.1) {
        for (source, options) in vrt::sources(path, options)? {
            files.extend(files_of(&source, &options)?);
        }
    }
    Ok(files)
}

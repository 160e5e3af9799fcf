//! The files that reading a volume looks at.

use std::path::{Path, PathBuf};

use super::nrrd;
use super::sections::pictures_of;
use crate::import::{RasterOptions, files_of as files_of_picture};
use spinney_base::Result;

/// All files that are looked at when an input of a volume is read, whether they are there or not: the file, and that of its samples, if they are
/// in another; of sections each picture, or all in a folder, with what may stand beside it.
///
/// # Errors
/// If the file, or the folder, cannot be read.
pub fn files_of(input: &Path, are_sections: bool) -> Result<Vec<PathBuf>> {
    if !are_sections {
        let mut files = vec![input.to_path_buf()];
        if nrrd::is_one(input) {
            files.extend(nrrd::data_file(input)?);
        }
        return Ok(files);
    }
    let mut files = Vec::new();
    for picture in pictures_of(&[input.to_path_buf()])?.0 {
        files.extend(files_of_picture(&picture, &RasterOptions::new())?);
    }
    Ok(files)
}

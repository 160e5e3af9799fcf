//! Input files of a volume, and how they are read.

use std::path::{Path, PathBuf};
use std::slice;

use super::sections::image_files;
use super::{RawLayout, VolumeImport, VolumeOptions, nrrd, plan, plan_raw, plan_sections};
use crate::import::{RasterOptions, files_of};
use spinney_base::Result;
use spinney_base::io::FileAccess;

/// Input files of a volume, and how they are read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum VolumeInput {
    /// A file with a header: see [`plan`].
    File(PathBuf),
    /// A file of raw samples: see [`plan_raw`].
    Raw(PathBuf, RawLayout),
    /// Images and directories of images that are the planes: see [`plan_sections`].
    Sections(Vec<PathBuf>),
}

impl VolumeInput {
    /// The files and directories as given.
    pub fn paths(&self) -> &[PathBuf] {
        match self {
            VolumeInput::File(path) | VolumeInput::Raw(path, _) => slice::from_ref(path),
            VolumeInput::Sections(paths) => paths,
        }
    }

    /// Opens the volume and plans its octree.
    ///
    /// # Errors
    /// Those of [`plan`], [`plan_raw`] and [`plan_sections`].
    pub fn plan(&self, options: &VolumeOptions) -> Result<VolumeImport> {
        match self {
            VolumeInput::File(path) => plan(path, options),
            VolumeInput::Raw(path, layout) => plan_raw(path, layout, options),
            VolumeInput::Sections(paths) => plan_sections(paths, options),
        }
    }

    /// Returns the files of the planes, in order; for other volumes the file itself.
    ///
    /// # Errors
    /// If a directory cannot be read, or has no images.
    pub fn images(&self) -> Result<Vec<PathBuf>> {
        match self {
            VolumeInput::Sections(paths) => Ok(image_files(paths)?.0),
            _ => Ok(self.paths().to_vec()),
        }
    }

    /// Returns all files that an import may read, whether they exist or not: the file and its
    /// separate data file, or each image with its possible sidecars.
    ///
    /// # Errors
    /// If a file or directory cannot be read.
    pub fn files(&self, access: &FileAccess) -> Result<Vec<PathBuf>> {
        let options = RasterOptions { access: access.clone(), ..RasterOptions::default() };
        let mut files = Vec::new();
        for image in self.images()? {
            match self {
                VolumeInput::Sections(_) => files.extend(files_of(&image, &options)?),
                VolumeInput::File(_) => files.extend(detached_data(&image)?),
                VolumeInput::Raw(..) => {}
            }
            files.push(image);
        }
        Ok(files)
    }
}

/// The separate file with a volume's samples, if it has one.
fn detached_data(path: &Path) -> Result<Option<PathBuf>> {
    if nrrd::is_one(path) { nrrd::data_file(path) } else { Ok(None) }
}

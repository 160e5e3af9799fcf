//! Files of a volume, and the way in which they are read.

use std::path::{Path, PathBuf};
use std::slice;

use super::sections::pictures_of;
use super::{RawLayout, VolumeImport, VolumeOptions, nrrd, plan, plan_raw, plan_sections};
use crate::import::{RasterOptions, files_of};
use spinney_base::Result;
use spinney_base::io::FileAccess;

/// Files of a volume, and the way in which they are read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum VolumeInput {
    /// A file that tells what it is: see [`plan`].
    File(PathBuf),
    /// A file of samples alone: see [`plan_raw`].
    Raw(PathBuf, RawLayout),
    /// Pictures and folders of these, which have the planes: see [`plan_sections`].
    Sections(Vec<PathBuf>),
}

impl VolumeInput {
    /// The files and folders, as they are named.
    pub fn paths(&self) -> &[PathBuf] {
        match self {
            VolumeInput::File(path) | VolumeInput::Raw(path, _) => slice::from_ref(path),
            VolumeInput::Sections(paths) => paths,
        }
    }

    /// Opens the volume, and decides how its octree is built.
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

    /// The files that have the planes, in their order; of other volumes the file.
    ///
    /// # Errors
    /// If a folder cannot be read, or has no pictures.
    pub fn pictures(&self) -> Result<Vec<PathBuf>> {
        match self {
            VolumeInput::Sections(paths) => Ok(pictures_of(paths)?.0),
            _ => Ok(self.paths().to_vec()),
        }
    }

    /// All files that are looked at when these are read, whether they are there or not: the file, and that of its samples, if they are in another;
    /// of planes each picture, with what may stand beside it.
    ///
    /// # Errors
    /// If a file, or a folder, cannot be read.
    pub fn files(&self, access: &FileAccess) -> Result<Vec<PathBuf>> {
        let options = RasterOptions { access: access.clone(), ..RasterOptions::default() };
        let mut files = Vec::new();
        for picture in self.pictures()? {
            match self {
                VolumeInput::Sections(_) => files.extend(files_of(&picture, &options)?),
                VolumeInput::File(_) => files.extend(data_beside(&picture)?),
                VolumeInput::Raw(..) => {}
            }
            files.push(picture);
        }
        Ok(files)
    }
}

/// The file that has a volume's samples, if that is another one.
fn data_beside(path: &Path) -> Result<Option<PathBuf>> {
    if nrrd::is_one(path) { nrrd::data_file(path) } else { Ok(None) }
}

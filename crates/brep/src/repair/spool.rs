//! Faces in an unnamed temporary file, which can be read repeatedly.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::boxes::{Bounds, bounds_of, union};
use crate::face_order::{StoredFace, write_face};
use crate::{ColumnValues, Face, Grid};
use spinney_base::{Error, Progress, Result};

/// Writes faces to a temporary file.
pub(super) struct FaceSpooler {
    grid: Grid,
    directory: PathBuf,
    file: BufWriter<File>,
    item: Vec<u8>,
    len: u64,
    bounds: Bounds,
}

/// Faces in a temporary file.
pub(super) struct FaceSpool {
    pub(super) grid: Grid,
    /// Directory of temporary files.
    pub(super) directory: PathBuf,
    file: File,
    pub(super) len: u64,
    pub(super) bounds: Bounds,
}

/// Receives a face and its values.
pub(super) type StoredFaceVisitor<'a> = dyn FnMut(&Face<'_>, &ColumnValues) -> Result<()> + 'a;

const BUFFER: usize = 1 << 20;

fn failed(directory: &Path) -> impl FnOnce(std::io::Error) -> Error {
    Error::io(directory, "use a temporary file")
}

impl FaceSpooler {
    /// Creates the file in a directory.
    ///
    /// # Errors
    /// If it cannot be created.
    pub(super) fn new(grid: Grid, directory: &Path) -> Result<FaceSpooler> {
        let file = tempfile::tempfile_in(directory).map_err(failed(directory))?;
        Ok(FaceSpooler {
            grid,
            directory: directory.to_path_buf(),
            file: BufWriter::with_capacity(BUFFER, file),
            item: Vec::new(),
            len: 0,
            bounds: [[i32::MAX; 3], [i32::MIN; 3]],
        })
    }

    /// Adds a face. Faces are numbered in this order.
    ///
    /// # Errors
    /// If the file cannot be written, or there are 2^32 faces.
    pub(super) fn push(&mut self, face: &Face<'_>, values: &[(&str, &str)]) -> Result<()> {
        if self.len == u64::from(u32::MAX) {
            let what = "the repair of 2^32 or more faces";
            return Err(Error::unsupported(&self.directory, what, "divide the model"));
        }
        self.item.clear();
        self.item.extend([0; 4]);
        write_face(&Face { number: self.len, ..*face }, values, &mut self.item);
        let length = self.item.len() as u32 - 4;
        self.item[..4].copy_from_slice(&length.to_le_bytes());
        self.file.write_all(&self.item).map_err(failed(&self.directory))?;
        self.len += 1;
        self.bounds = union(self.bounds, &bounds_of(face.points, 0));
        Ok(())
    }

    /// Returns the complete list.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn finish(self) -> Result<FaceSpool> {
        let FaceSpooler { grid, directory, file, len, bounds, .. } = self;
        let file = file.into_inner().map_err(|error| failed(&directory)(error.into_error()))?;
        Ok(FaceSpool { grid, directory, file, len, bounds })
    }
}

impl FaceSpool {
    /// Passes all faces to a function, in the order of their numbers.
    ///
    /// # Errors
    /// If the file cannot be read, those of the function, or on cancellation.
    pub(super) fn each(&self, progress: &dyn Progress, each: &mut StoredFaceVisitor<'_>) -> Result<()> {
        let failed = || failed(&self.directory);
        // (Only one pass at a time reads the file: all share its position.)
        (&self.file).seek(SeekFrom::Start(0)).map_err(failed())?;
        let mut file = BufReader::with_capacity(BUFFER, &self.file);
        let (mut item, mut face) = (Vec::new(), StoredFace::default());
        for number in 0..self.len {
            if number.is_multiple_of(1 << 12) {
                progress.check()?;
            }
            let mut length = [0; 4];
            file.read_exact(&mut length).map_err(failed())?;
            item.resize(u32::from_le_bytes(length) as usize, 0);
            file.read_exact(&mut item).map_err(failed())?;
            face.read(&item);
            each(&face.face(), &face.values)?;
        }
        Ok(())
    }
}

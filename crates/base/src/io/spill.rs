//! Output that is held in temporary files.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::io::Output;
use crate::{Error, Result};

/// Output that must follow bytes that are not known yet, in an unnamed temporary file. The file is
/// in the output's directory if there is one, since that must have the space anyway.
pub struct Spill {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Spill {
    /// Creates the temporary file.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn new(output: &Output) -> Result<Spill> {
        let path = output.path().to_path_buf();
        let file = match output.is_file() {
            true => tempfile::tempfile_in(crate::io::directory_of(&path)),
            false => tempfile::tempfile(),
        };
        let file = file.map_err(Error::io(&path, "create a temporary file"))?;
        Ok(Spill { path, file: BufWriter::with_capacity(1 << 20, file) })
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes).map_err(|cause| failed(&self.path)(cause))
    }

    /// Copies all bytes to the output.
    pub fn copy_to(self, output: &mut Output) -> Result<()> {
        let copy = || -> io::Result<()> {
            let mut file = self.file.into_inner().map_err(io::IntoInnerError::into_error)?;
            file.seek(SeekFrom::Start(0))?;
            let mut file = BufReader::with_capacity(1 << 20, file);
            let mut buffer = vec![0; 1 << 20];
            loop {
                match file.read(&mut buffer)? {
                    0 => return Ok(()),
                    count => output.write_all(&buffer[..count])?,
                }
            }
        };
        copy().map_err(failed(&self.path))
    }
}

/// Returns a conversion of write errors.
pub fn failed(path: &Path) -> impl FnOnce(io::Error) -> Error {
    Error::io(path, "write")
}

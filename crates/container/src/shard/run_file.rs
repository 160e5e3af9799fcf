//! Sequential reader of run files.

use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use spinney_base::io::InputFile;
use spinney_base::{Error, Result};

/// Read buffer in bytes.
const BUFFER: usize = 1 << 18;

/// The bytes of a run file, in order.
pub struct RunFile {
    path: PathBuf,
    file: BufReader<InputFile>,
}

impl RunFile {
    /// Creates a reader that starts at the position of `file`. The path is for messages.
    pub fn new(path: &Path, file: InputFile) -> RunFile {
        RunFile { path: path.to_path_buf(), file: BufReader::with_capacity(BUFFER, file) }
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Replaces the contents of `bytes` by the next `length` bytes of the file.
    ///
    /// # Errors
    /// If there are fewer, or they cannot be read.
    pub fn read(&mut self, length: u64, bytes: &mut Vec<u8>) -> Result<()> {
        bytes.clear();
        // Do not reserve capacity: the length comes from a summary and may be untrusted.
        let read = self.file.by_ref().take(length).read_to_end(bytes);
        read.map_err(Error::io(&self.path, "read"))?;
        if bytes.len() as u64 != length {
            let found = format!("{} bytes", bytes.len());
            return Err(Error::corrupt(&self.path, "shard run", found, format!("{length} bytes")));
        }
        Ok(())
    }
}

//! Options of opening tree files.

use std::path::Path;

use spinney_base::io::{FileId, Mapped, Positioned, ReadBackend, open_input, positioned_reads_are_preferred};
use spinney_base::{Error, Result};

/// Options of reading a file.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct OpenOptions {
    /// Read with positioned reads instead of mapping the file: for network folders and files that somebody
    /// may truncate meanwhile.
    pub positioned: bool,
    /// Bytes of segments kept in memory when reading with positioned reads.
    pub cache: u64,
    /// Check each segment's checksum the first time it is used.
    pub check: bool,
}

impl Default for OpenOptions {
    fn default() -> Self {
        OpenOptions { positioned: positioned_reads_are_preferred(), cache: 64 << 20, check: true }
    }
}

impl OpenOptions {
    /// The usual way: mapped, with checks; or what [`prefer_positioned_reads`](spinney_base::io::prefer_positioned_reads)
    /// has chosen.
    pub fn new() -> OpenOptions {
        OpenOptions::default()
    }

    /// Chooses positioned reads instead of mapping the file, and the bytes that are kept in memory.
    #[must_use]
    pub fn positioned(self, cache: u64) -> OpenOptions {
        OpenOptions { positioned: true, cache, ..self }
    }

    /// Chooses whether checksums are checked the first time that something is used.
    #[must_use]
    pub fn check(self, check: bool) -> OpenOptions {
        OpenOptions { check, ..self }
    }

    /// The file's bytes, the way that was asked for.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn open(&self, path: &Path) -> Result<Box<dyn ReadBackend>> {
        self.open_with_id(path).map(|(backend, _)| backend)
    }

    /// The file's bytes, the way that was asked for, and which file it is: two looks at a path may see two
    /// files.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn open_with_id(&self, path: &Path) -> Result<(Box<dyn ReadBackend>, FileId)> {
        let file = open_input(path)?;
        let id = FileId::of(&file).map_err(Error::io(path, "open"))?;
        let backend: Box<dyn ReadBackend> = if self.positioned {
            Box::new(Positioned::of(file, path)?)
        } else {
            Box::new(Mapped::of(&file, path)?)
        };
        Ok((backend, id))
    }
}

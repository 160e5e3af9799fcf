//! Positioned, durable writes to files, or to substitutes in tests.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use super::access::FileAccess;
use super::faults::MayFail;
use super::file_id::FileId;
use super::read::{Mapped, Positioned, ReadBackend};
use crate::{Error, Result};

/// Storage that is written at any offset and made durable: a file, or a substitute in tests.
///
/// Until [`WriteBackend::sync`] returns, writes may become durable in any order, partially, or not
/// at all.
pub trait WriteBackend: Send {
    /// Writes bytes at an offset, which may lie after the end.
    ///
    /// # Errors
    /// If that fails; some of the bytes may be written.
    fn write(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()>;

    /// Makes all written bytes durable.
    ///
    /// # Errors
    /// If that fails. Bytes written since the last success may then be lost even if a later call
    /// succeeds.
    fn sync(&mut self) -> io::Result<()>;

    /// Returns a reader of the present bytes.
    ///
    /// # Errors
    /// If they cannot be read.
    fn reader(&self) -> Result<Box<dyn ReadBackend>>;

    /// Returns the identity of the file.
    fn id(&self) -> FileId;

    /// Returns the access with which readers open the file.
    fn access(&self) -> FileAccess {
        FileAccess::default()
    }

    /// Checks that readers will find the written bytes: that the file is still at its path.
    ///
    /// # Errors
    /// If it is not.
    fn check_path(&self) -> Result<()> {
        Ok(())
    }
}

/// A file that is written with positioned writes, never through a mapping.
pub struct FileBackend {
    /// The open file.
    pub file: File,
    /// Its path, for messages.
    pub path: PathBuf,
    faults: MayFail,
    /// Maximum size of the file in bytes.
    most: u64,
    /// Access with which readers open the file.
    access: FileAccess,
}

impl FileBackend {
    /// Writes to an open file, whose readers use `access`.
    pub fn new(file: File, path: &Path, access: &FileAccess) -> FileBackend {
        FileBackend::of_output(file, path, (MayFail::default(), u64::MAX), access)
    }

    /// Returns the file of an output that may have at most `most` bytes.
    pub(super) fn of_output(
        file: File,
        path: &Path,
        (faults, most): (MayFail, u64),
        access: &FileAccess,
    ) -> FileBackend {
        FileBackend { file, path: path.to_path_buf(), faults, most, access: access.clone() }
    }
}

impl WriteBackend for FileBackend {
    fn write(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        check_limit(offset, bytes.len(), self.most)?;
        self.faults.write_all_at(&self.file, bytes, offset)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.faults.sync()?;
        self.file.sync_data()
    }

    fn reader(&self) -> Result<Box<dyn ReadBackend>> {
        if self.access.is_positioned() {
            let file = self.file.try_clone().map_err(Error::io(&self.path, "open"))?;
            return Ok(Box::new(Positioned::of(file, &self.path)?));
        }
        Ok(Box::new(Mapped::of(&self.file, &self.path)?))
    }

    fn access(&self) -> FileAccess {
        self.access.clone()
    }

    fn id(&self) -> FileId {
        FileId::of(&self.file).unwrap_or_else(|_| FileId::unique())
    }
}

/// Fails if `more` bytes after the first `written` ones would exceed the maximum `most`.
pub(super) fn check_limit(written: u64, more: usize, most: u64) -> io::Result<()> {
    if written.saturating_add(more as u64) <= most {
        return Ok(());
    }
    let message = format!("it would exceed the {most} bytes that are allowed");
    Err(io::Error::new(io::ErrorKind::FileTooLarge, message))
}

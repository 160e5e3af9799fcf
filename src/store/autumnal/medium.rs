//! What an Autumnal file is written to.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use crate::Result;
use crate::store::{Mapped, Storage};

/// Somewhere bytes can be written at any place and made durable: a file, or what tests put in its place.
///
/// Writes may become durable in any order, in part or not at all, until [`Medium::sync`] returns.
pub trait Medium: Send {
    /// Writes bytes at a place, which may lie behind the end.
    ///
    /// # Errors
    /// If that fails; some of the bytes may be written.
    fn write(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()>;

    /// Makes all that was written durable.
    ///
    /// # Errors
    /// If that fails. What was written since the last success may then be lost even if a later call succeeds.
    fn sync(&mut self) -> io::Result<()>;

    /// The bytes as they are now, to be read.
    ///
    /// # Errors
    /// If they cannot be read.
    fn storage(&self) -> Result<Box<dyn Storage>>;

    /// Which file it is.
    fn id(&self) -> FileId;
}

/// Tells files apart, whatever names they have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FileId(u64, u64);

impl FileId {
    /// That of an open file. Where the system has no such numbers, every call gives another one: nothing is then known
    /// to be the same file.
    ///
    /// # Errors
    /// If the system cannot tell.
    pub fn of(file: &File) -> io::Result<FileId> {
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt;
            let metadata = file.metadata()?;
            Ok(FileId(metadata.dev(), metadata.ino()))
        }
        #[cfg(not(unix))]
        {
            let _ = file;
            Ok(FileId::unique())
        }
    }

    /// One that nothing else has: for bytes in memory.
    pub fn unique() -> FileId {
        use std::sync::atomic::{AtomicU64, Ordering};
        static NEXT: AtomicU64 = AtomicU64::new(0);
        FileId(u64::MAX, NEXT.fetch_add(1, Ordering::Relaxed))
    }
}

/// A file. Written with ordinary positioned writes, never through a mapping.
pub(super) struct FileMedium {
    pub(super) file: File,
    pub(super) path: PathBuf,
}

impl FileMedium {
    pub(super) fn new(file: File, path: &Path) -> FileMedium {
        FileMedium { file, path: path.to_path_buf() }
    }
}

impl Medium for FileMedium {
    fn write(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        write_all_at(&self.file, bytes, offset)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.file.sync_data()
    }

    fn storage(&self) -> Result<Box<dyn Storage>> {
        Ok(Box::new(Mapped::of(&self.file, &self.path)?))
    }

    fn id(&self) -> FileId {
        FileId::of(&self.file).unwrap_or_else(|_| FileId::unique())
    }
}

#[cfg(unix)]
fn write_all_at(file: &File, bytes: &[u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, offset)
}

#[cfg(windows)]
fn write_all_at(file: &File, mut bytes: &[u8], mut offset: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_write(file, bytes, offset)? {
            0 => return Err(io::ErrorKind::WriteZero.into()),
            written => {
                bytes = &bytes[written..];
                offset += written as u64;
            }
        }
    }
    Ok(())
}

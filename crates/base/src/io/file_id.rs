//! Identity of open files, whatever their names.

use std::fs::File;
use std::io;
use std::path::Path;

use super::platform::device_and_inode;

/// Identity of a file, whatever names it has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FileId(u64, u64);

impl FileId {
    /// The identity of an open file. Where the system has no such numbers, every call gives another one:
    /// nothing is then known to be the same file.
    ///
    /// # Errors
    /// If the system cannot tell.
    pub fn of(file: &File) -> io::Result<FileId> {
        Ok(FileId::from_metadata(&file.metadata()?))
    }

    /// The identity of the file that a path leads to now.
    ///
    /// # Errors
    /// If there is none, or the system cannot tell.
    pub fn at(path: &Path) -> io::Result<FileId> {
        Ok(FileId::from_metadata(&std::fs::metadata(path)?))
    }

    /// The identity of the file that the system tells this of.
    pub fn from_metadata(metadata: &std::fs::Metadata) -> FileId {
        device_and_inode(metadata).map_or_else(FileId::unique, |(device, inode)| FileId(device, inode))
    }

    /// An identity that nothing else has: for bytes in memory.
    pub fn unique() -> FileId {
        use std::sync::atomic::{AtomicU64, Ordering};
        static NEXT: AtomicU64 = AtomicU64::new(0);
        FileId(u64::MAX, NEXT.fetch_add(1, Ordering::Relaxed))
    }

    /// Whether it is one that nothing else has, from which nothing can be learned about files.
    pub fn is_unique(self) -> bool {
        self.0 == u64::MAX
    }
}

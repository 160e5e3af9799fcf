//! Identity of open files, independent of their names.

use std::fs::File;
use std::io;
use std::path::Path;

use super::platform::device_and_inode;

/// Identity of a file, independent of its names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FileId(u64, u64);

impl FileId {
    /// Returns the identity of an open file. On systems without device and inode numbers, each call
    /// returns a unique identity: no two files are then known to be the same.
    ///
    /// # Errors
    /// If the system does not report it.
    pub fn of(file: &File) -> io::Result<FileId> {
        Ok(FileId::from_metadata(&file.metadata()?))
    }

    /// Returns the identity of the file that is at a path now.
    ///
    /// # Errors
    /// If there is none, or the system does not report it.
    pub fn at(path: &Path) -> io::Result<FileId> {
        Ok(FileId::from_metadata(&std::fs::metadata(path)?))
    }

    /// Returns the identity of the file with this metadata.
    pub fn from_metadata(metadata: &std::fs::Metadata) -> FileId {
        device_and_inode(metadata).map_or_else(FileId::unique, |(device, inode)| FileId(device, inode))
    }

    /// Returns an identity that no other file has: for bytes in memory.
    pub fn unique() -> FileId {
        use std::sync::atomic::{AtomicU64, Ordering};
        static NEXT: AtomicU64 = AtomicU64::new(0);
        FileId(u64::MAX, NEXT.fetch_add(1, Ordering::Relaxed))
    }

    /// Whether this is a [unique](FileId::unique) identity, which implies nothing about other
    /// files.
    pub fn is_unique(self) -> bool {
        self.0 == u64::MAX
    }
}

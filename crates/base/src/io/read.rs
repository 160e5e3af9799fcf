//! Access to a file's bytes: mapped, by positioned reads, or in memory.

use std::borrow::Cow;
use std::fs::File;
use std::io;
use std::ops::{Deref, Range};
use std::path::Path;
use std::sync::Arc;

use super::cache::CachedBytes;
use super::platform::read_exact_at;
use super::stat::FileStat;
use crate::{Error, Result};

/// Bytes of a file that is only read.
pub trait ReadBackend: Send + Sync {
    /// Returns the number of bytes.
    fn len(&self) -> u64;

    /// Whether there are no bytes.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns all bytes, if they are accessible without a copy.
    fn bytes(&self) -> Option<&[u8]>;

    /// Returns the present version of the file; `None` if the bytes cannot change, or if each read
    /// checks that they have not (remote files).
    ///
    /// # Errors
    /// If the system does not report it.
    fn stat(&self) -> Result<Option<FileStat>> {
        Ok(None)
    }

    /// Returns the version of the file when it was opened. Call it before anything is read.
    ///
    /// # Errors
    /// If the system does not report it.
    fn version(&self) -> Result<Option<FileStat>> {
        self.stat()
    }

    /// Checks with the host of a remote file that this is still the version that was opened. (Local
    /// files: see [`ReadBackend::stat`].)
    ///
    /// # Errors
    /// [`Error::Changed`] if it is not. Also if the host does not respond, or the file is gone.
    fn check_remote(&self) -> Result<()> {
        Ok(())
    }

    /// Reads bytes. The range must lie within the length.
    ///
    /// # Errors
    /// If they cannot be read.
    fn read(&self, offset: u64, length: usize) -> Result<Cow<'_, [u8]>>;

    /// Reads bytes that are likely to be read again, such as a segment's: from the mapping, or from
    /// a cache if there is one. The range must lie within the length.
    ///
    /// # Errors
    /// If they cannot be read.
    fn share(&self, offset: u64, length: usize) -> Result<FileBytes<'_>> {
        Ok(match self.read(offset, length)? {
            Cow::Borrowed(bytes) => FileBytes::Mapped(bytes),
            Cow::Owned(bytes) => FileBytes::Cached(Arc::new(bytes).into()),
        })
    }

    /// Whether [shared](ReadBackend::share) bytes are cached.
    fn has_cache(&self) -> bool {
        false
    }

    /// Announces that small ranges far from each other will be read: fewer bytes between them are
    /// fetched with them.
    fn reads_small_ranges(&self) {}

    /// Announces ranges, which must lie within the length, that will be read soon. Those of a
    /// remote file are fetched all at once.
    ///
    /// # Errors
    /// If they cannot be fetched.
    fn prefetch(&self, _: &[Range<u64>]) -> Result<()> {
        Ok(())
    }
}

impl ReadBackend for Vec<u8> {
    fn len(&self) -> u64 {
        self.as_slice().len() as u64
    }

    fn bytes(&self) -> Option<&[u8]> {
        Some(self)
    }

    fn read(&self, offset: u64, length: usize) -> Result<Cow<'_, [u8]>> {
        Ok(Cow::Borrowed(&self[offset as usize..][..length]))
    }
}

/// A file that is mapped into memory. Reads return slices of the mapping, without a copy.
///
/// If another process truncates the file, access to a lost page kills this process (SIGBUS). Files
/// that Spinney publishes are replaced by a rename, which is safe. For untrusted writers and
/// network file systems use [`Positioned`].
pub struct Mapped {
    map: memmap2::Mmap,
    file: File,
    path: std::path::PathBuf,
}

impl Mapped {
    /// Maps a file.
    ///
    /// # Errors
    /// If it cannot be opened or mapped.
    pub fn open(path: &Path) -> Result<Mapped> {
        Mapped::of(&open_input(path)?, path)
    }

    /// Maps an open file. The path is for messages.
    ///
    /// # Errors
    /// If it is empty or cannot be mapped.
    pub fn of(file: &File, path: &Path) -> Result<Mapped> {
        let length = file.metadata().map_err(Error::io(path, "open"))?.len();
        if length == 0 {
            return Err(Error::corrupt(path, "file", "0 bytes", "a Spinney file"));
        }
        // SAFETY: the mapping is read-only, and its slices are only read as plain integers. Readers
        // check every number before use, so bytes that change during a read lead to wrong results
        // or errors, not to invalid lengths. Truncation is the documented risk above.
        #[allow(unsafe_code)]
        let map = unsafe { memmap2::Mmap::map(file) }.map_err(Error::io(path, "map"))?;
        let file = file.try_clone().map_err(Error::io(path, "open"))?;
        Ok(Mapped { map, file, path: path.to_path_buf() })
    }

    /// Releases the memory of all pages to the system, which reads them again on the next access. A
    /// single scan of a large file thus need not keep the pages that it has passed.
    pub fn release_pages(&self) {
        #[cfg(unix)]
        {
            // SAFETY: pages of a read-only file mapping contain only bytes of the file. They are
            // read again unchanged, or with the file's present bytes, which the mapping allows for
            // anyway.
            #[allow(unsafe_code)]
            let done = unsafe { self.map.unchecked_advise(memmap2::UncheckedAdvice::DontNeed) };
            // Failures are ignored: the pages then stay in memory.
            let _ = done;
        }
    }
}

impl ReadBackend for Mapped {
    fn len(&self) -> u64 {
        self.map.len() as u64
    }

    fn bytes(&self) -> Option<&[u8]> {
        Some(&self.map)
    }

    fn stat(&self) -> Result<Option<FileStat>> {
        FileStat::of(&self.file, &self.path).map(Some)
    }

    fn read(&self, offset: u64, length: usize) -> Result<Cow<'_, [u8]>> {
        Ok(Cow::Borrowed(&self.map[offset as usize..][..length]))
    }
}

/// A file that is read with positioned reads. Each read copies, and failures are returned as
/// errors.
pub struct Positioned {
    file: File,
    length: u64,
    path: std::path::PathBuf,
}

impl Positioned {
    /// Opens a file.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub fn open(path: &Path) -> Result<Positioned> {
        Positioned::of(open_input(path)?, path)
    }

    /// Reads an open file. The path is for messages.
    ///
    /// # Errors
    /// If its length cannot be determined.
    pub fn of(file: File, path: &Path) -> Result<Positioned> {
        let length = file.metadata().map_err(Error::io(path, "open"))?.len();
        Ok(Positioned { file, length, path: path.to_path_buf() })
    }
}

impl ReadBackend for Positioned {
    fn len(&self) -> u64 {
        self.length
    }

    fn bytes(&self) -> Option<&[u8]> {
        None
    }

    fn stat(&self) -> Result<Option<FileStat>> {
        FileStat::of(&self.file, &self.path).map(Some)
    }

    fn read(&self, offset: u64, length: usize) -> Result<Cow<'_, [u8]>> {
        let mut bytes = vec![0; length];
        read_exact_at(&self.file, &mut bytes, offset).map_err(Error::io(&self.path, "read"))?;
        Ok(Cow::Owned(bytes))
    }
}

/// Bytes of a file: in its mapping, or in a cache.
#[derive(Clone)]
pub enum FileBytes<'a> {
    /// Bytes of the mapping.
    Mapped(&'a [u8]),
    /// Bytes that were read.
    Cached(CachedBytes),
}

impl FileBytes<'_> {
    /// Returns a slice of the bytes, which must lie within them.
    #[must_use]
    pub fn part(self, part: Range<usize>) -> Self {
        match self {
            FileBytes::Mapped(bytes) => FileBytes::Mapped(&bytes[part]),
            FileBytes::Cached(bytes) => FileBytes::Cached(bytes.part(part)),
        }
    }
}

impl Deref for FileBytes<'_> {
    type Target = [u8];

    #[inline]
    fn deref(&self) -> &[u8] {
        match self {
            FileBytes::Mapped(bytes) => bytes,
            FileBytes::Cached(bytes) => bytes,
        }
    }
}

/// Opens a file for positioned or repeated reads. Refuses pipes and devices: opening a pipe would
/// wait for a writer.
///
/// # Errors
/// If it cannot be opened, or is not a regular file.
pub fn open_input(path: &Path) -> Result<File> {
    let found = std::fs::metadata(path);
    if found.as_ref().is_ok_and(std::fs::Metadata::is_dir) {
        let cause = io::Error::new(io::ErrorKind::IsADirectory, "is a directory, expected a file");
        return Err(Error::io(path, "open")(cause));
    }
    if found.is_ok_and(|found| !found.is_file()) {
        return Err(Error::unsupported(path, "a pipe or device as input", "write its bytes to a file first"));
    }
    File::open(path).map_err(Error::io(path, "open"))
}

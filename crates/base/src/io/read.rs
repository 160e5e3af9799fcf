//! Access to a file's bytes: mapped, by positioned reads, or in memory.

use std::borrow::Cow;
use std::fs::File;
use std::ops::{Deref, Range};
use std::path::Path;
use std::sync::Arc;

use super::cache::CachedBytes;
use super::platform::read_exact_at;
use super::stat::FileStat;
use crate::{Error, Result};

/// The bytes of a file that is only read.
pub trait ReadBackend: Send + Sync {
    /// Number of bytes.
    fn len(&self) -> u64;

    /// Whether there are no bytes.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All bytes, where they can be seen without copying.
    fn bytes(&self) -> Option<&[u8]>;

    /// Version of the file as it is now; `None` where the bytes cannot change, or each read checks that they have not (remote files).
    ///
    /// # Errors
    /// If the system does not report it.
    fn stat(&self) -> Result<Option<FileStat>> {
        Ok(None)
    }

    /// Version of the file when it was opened: queried before anything is read.
    ///
    /// # Errors
    /// If the system does not report it.
    fn version(&self) -> Result<Option<FileStat>> {
        self.stat()
    }

    /// Queries the host of a remote file whether this is still the version that was opened. (Local files: see [`ReadBackend::stat`].)
    ///
    /// # Errors
    /// [`Error::Changed`] if it is not; also if the host does not respond, or has no such file any more.
    fn check_remote(&self) -> Result<()> {
        Ok(())
    }

    /// Some bytes; the range must lie within the length.
    ///
    /// # Errors
    /// If they cannot be read.
    fn read(&self, offset: u64, length: usize) -> Result<Cow<'_, [u8]>>;

    /// Bytes that are likely to be asked for again, such as a segment's: where they are mapped, or held by a cache if there is one.
    /// The range must lie within the length.
    ///
    /// # Errors
    /// If they cannot be read.
    fn share(&self, offset: u64, length: usize) -> Result<FileBytes<'_>> {
        Ok(match self.read(offset, length)? {
            Cow::Borrowed(bytes) => FileBytes::Mapped(bytes),
            Cow::Owned(bytes) => FileBytes::Held(Arc::new(bytes).into()),
        })
    }

    /// Whether bytes that were [shared](ReadBackend::share) are kept for a while.
    fn has_cache(&self) -> bool {
        false
    }

    /// Says that some ranges, which must lie within the length, will be asked for soon: bytes that come from elsewhere are fetched all at once.
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

/// A file mapped into memory: bytes are seen where the system's cache has them.
///
/// If another process truncates the file, touching a lost page kills this one (SIGBUS); files that Spinney
/// publishes are replaced by renaming, which is safe. For untrusted writers and network folders use
/// [`Positioned`].
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

    /// Maps an open file; the path is for messages.
    ///
    /// # Errors
    /// If it is empty or cannot be mapped.
    pub fn of(file: &File, path: &Path) -> Result<Mapped> {
        let length = file.metadata().map_err(Error::io(path, "open"))?.len();
        if length == 0 {
            return Err(Error::corrupt(path, "file", "0 bytes", "a Spinney file"));
        }
        // SAFETY: the mapping is read-only, and readers check every number they take from it before use, so
        // that even bytes that change under us lead to wrong answers or errors, not to undefined lengths:
        // slices of it are only ever read as plain integers. Truncation is the documented risk above.
        #[allow(unsafe_code)]
        let map = unsafe { memmap2::Mmap::map(file) }.map_err(Error::io(path, "map"))?;
        let file = file.try_clone().map_err(Error::io(path, "open"))?;
        Ok(Mapped { map, file, path: path.to_path_buf() })
    }

    /// Gives the memory behind all pages back to the system, which reads them anew when they are looked at
    /// again: who reads a large file once from beginning to end need not hold what is behind.
    pub fn release_pages(&self) {
        #[cfg(unix)]
        {
            // SAFETY: pages of a read-only mapping of a file have nothing that is not in the file; they come
            // back as they were, or as the file is by then, which the mapping allows for anyway.
            #[allow(unsafe_code)]
            let done = unsafe { self.map.unchecked_advise(memmap2::UncheckedAdvice::DontNeed) };
            // A system that cannot do it has to live with the pages.
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

/// A file read with positioned reads: every answer is a copy, errors are errors.
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

    /// Reads an open file; the path is for messages.
    ///
    /// # Errors
    /// If its length is not to be had.
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

/// Bytes of a file: where they are mapped, or held by a cache.
#[derive(Clone)]
pub enum FileBytes<'a> {
    /// Bytes of the mapping.
    Mapped(&'a [u8]),
    /// Bytes that were read.
    Held(CachedBytes),
}

impl FileBytes<'_> {
    /// A part of the bytes, which must lie within.
    #[must_use]
    pub fn part(self, part: Range<usize>) -> Self {
        match self {
            FileBytes::Mapped(bytes) => FileBytes::Mapped(&bytes[part]),
            FileBytes::Held(bytes) => FileBytes::Held(bytes.part(part)),
        }
    }
}

impl Deref for FileBytes<'_> {
    type Target = [u8];

    #[inline]
    fn deref(&self) -> &[u8] {
        match self {
            FileBytes::Mapped(bytes) => bytes,
            FileBytes::Held(bytes) => bytes,
        }
    }
}

/// Opens a file that is to be read at positions, more than once or beside others: pipes and devices are refused, of which the first would
/// wait for a writer.
///
/// # Errors
/// If it cannot be opened, or is no file.
pub fn open_input(path: &Path) -> Result<File> {
    let is_stream = std::fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir());
    if is_stream {
        return Err(Error::unsupported(
            path,
            "a pipe or device as input",
            "write what comes from it to a file first",
        ));
    }
    File::open(path).map_err(Error::io(path, "open"))
}

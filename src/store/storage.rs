//! Where a file's bytes are: mapped, read at positions, or in memory.

use std::borrow::Cow;
use std::fs::File;
use std::path::Path;

use crate::{Error, Result};

/// The bytes of a file that is only read.
pub trait Storage: Send + Sync {
    /// Number of bytes.
    fn len(&self) -> u64;

    /// Whether there are no bytes.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All bytes, where they can be seen without copying.
    fn bytes(&self) -> Option<&[u8]>;

    /// Some bytes; the range must lie within the length.
    ///
    /// # Errors
    /// If they cannot be read.
    fn read(&self, offset: u64, length: usize) -> Result<Cow<'_, [u8]>>;
}

impl Storage for Vec<u8> {
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
pub struct Mapped(memmap2::Mmap);

impl Mapped {
    /// Maps a file.
    ///
    /// # Errors
    /// If it cannot be opened or mapped.
    pub fn open(path: &Path) -> Result<Mapped> {
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        let length = file.metadata().map_err(Error::io(path, "open"))?.len();
        if length == 0 {
            return Err(Error::corrupt(path, "file", "0 bytes", "a Spinney file"));
        }
        Mapped::of(&file, path)
    }

    /// Maps an open file that is not empty; the path is for messages.
    ///
    /// # Errors
    /// If it cannot be mapped.
    pub(crate) fn of(file: &File, path: &Path) -> Result<Mapped> {
        // SAFETY: the mapping is read-only, and readers check every number they take from it before use, so
        // that even bytes that change under us lead to wrong answers or errors, not to undefined lengths:
        // slices of it are only ever read as plain integers. Truncation is the documented risk above.
        #[allow(unsafe_code)]
        let map = unsafe { memmap2::Mmap::map(file) }.map_err(Error::io(path, "map"))?;
        Ok(Mapped(map))
    }

    /// Gives the memory behind all pages back to the system, which reads them anew when they are looked at again: who reads a
    /// large file once from beginning to end need not hold what is behind.
    pub fn let_go(&self) {
        #[cfg(unix)]
        {
            // SAFETY: pages of a read-only mapping of a file have nothing that is not in the file; they come back as they
            // were, or as the file is by then, which the mapping allows for anyway.
            #[allow(unsafe_code)]
            let done = unsafe { self.0.unchecked_advise(memmap2::UncheckedAdvice::DontNeed) };
            // A system that cannot do it has to live with the pages.
            let _ = done;
        }
    }
}

impl Storage for Mapped {
    fn len(&self) -> u64 {
        self.0.len() as u64
    }

    fn bytes(&self) -> Option<&[u8]> {
        Some(&self.0)
    }

    fn read(&self, offset: u64, length: usize) -> Result<Cow<'_, [u8]>> {
        Ok(Cow::Borrowed(&self.0[offset as usize..][..length]))
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
        let file = File::open(path).map_err(Error::io(path, "open"))?;
        let length = file.metadata().map_err(Error::io(path, "open"))?.len();
        Ok(Positioned { file, length, path: path.to_path_buf() })
    }
}

impl Storage for Positioned {
    fn len(&self) -> u64 {
        self.length
    }

    fn bytes(&self) -> Option<&[u8]> {
        None
    }

    fn read(&self, offset: u64, length: usize) -> Result<Cow<'_, [u8]>> {
        let mut bytes = vec![0; length];
        read_exact_at(&self.file, &mut bytes, offset).map_err(Error::io(&self.path, "read"))?;
        Ok(Cow::Owned(bytes))
    }
}

#[cfg(unix)]
fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

#[cfg(windows)]
fn read_exact_at(file: &File, mut bytes: &mut [u8], mut offset: u64) -> std::io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, bytes, offset)? {
            0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            read => {
                bytes = &mut bytes[read..];
                offset += read as u64;
            }
        }
    }
    Ok(())
}

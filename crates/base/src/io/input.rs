//! Sequential and random reads of local and remote files.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::platform::read_exact_at;
use super::read::{ReadBackend, open_input};
use super::stat::FileStat;
use crate::url::{split_query, url_of, without_query};
use crate::{Error, Result};

/// A local or remote file that is read sequentially, from another offset on, or at offsets by
/// several threads.
///
/// Errors of remote files pass through [`io::Error`] unchanged: [`Error::io`] unwraps them.
pub struct InputFile {
    bytes: Bytes,
    length: u64,
    /// Offset of the next byte that is read from a remote file.
    at: u64,
}

enum Bytes {
    Local(File),
    Remote(Box<dyn ReadBackend>),
}

impl InputFile {
    /// Opens a local file.
    pub(super) fn local(path: &Path) -> Result<InputFile> {
        let file = open_input(path)?;
        let length = file.metadata().map_err(Error::io(path, "read the file size"))?.len();
        Ok(InputFile { bytes: Bytes::Local(file), length, at: 0 })
    }

    /// Reads a remote file.
    pub(super) fn remote(file: Box<dyn ReadBackend>) -> InputFile {
        InputFile { length: file.len(), bytes: Bytes::Remote(file), at: 0 }
    }

    /// Reads all bytes. Fails if there are more than `limit`. The path is for messages.
    pub(super) fn into_bytes(mut self, path: &Path, limit: u64) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        // Another process may be appending to the file.
        let read = self.by_ref().take(limit.saturating_add(1)).read_to_end(&mut bytes);
        read.map_err(Error::io(path, "read"))?;
        if bytes.len() as u64 > limit {
            return Err(Error::corrupt(path, "length", format!("more than {limit} bytes"), "at most that"));
        }
        Ok(bytes)
    }

    /// Returns the number of bytes.
    pub fn len(&self) -> u64 {
        self.length
    }

    /// Whether there are no bytes.
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Fills a buffer with the bytes from an offset on. The cursor has no effect and does not move.
    pub fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        match &self.bytes {
            Bytes::Local(file) => read_exact_at(file, buffer, offset),
            Bytes::Remote(file) => {
                let end = offset.checked_add(buffer.len() as u64).filter(|end| *end <= self.length);
                end.ok_or(io::ErrorKind::UnexpectedEof)?;
                let bytes = file.share(offset, buffer.len()).map_err(Error::into_io)?;
                buffer.copy_from_slice(&bytes);
                Ok(())
            }
        }
    }

    /// Announces ranges, which must lie within the length, that will be read soon. Those of a
    /// remote file are fetched all at once, as far as they fit into its cache.
    ///
    /// # Errors
    /// If they cannot be fetched.
    pub fn prefetch(&self, ranges: &[Range<u64>]) -> Result<()> {
        match &self.bytes {
            Bytes::Local(_) => Ok(()),
            Bytes::Remote(file) => file.prefetch(ranges),
        }
    }

    /// Returns length and version of the open file; `None` if the host of a remote file does not
    /// report these with its bytes. `path` is for messages.
    ///
    /// # Errors
    /// If the system does not report them.
    pub fn stat(&self, path: &Path) -> Result<Option<FileStat>> {
        match &self.bytes {
            Bytes::Local(file) => FileStat::of(file, path).map(Some),
            Bytes::Remote(file) => file.version(),
        }
    }

    /// Whether the file is remote, so that each read of new bytes takes a request.
    pub fn is_remote(&self) -> bool {
        matches!(self.bytes, Bytes::Remote(_))
    }
}

/// Whether an error denies the permission to read a remote file.
pub(super) fn is_access_denied(path: &Path, error: &Error) -> bool {
    let is_denied =
        matches!(error, Error::Io { cause, .. } if cause.kind() == io::ErrorKind::PermissionDenied);
    is_denied && url_of(path).is_some()
}

impl Read for InputFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let length = match &mut self.bytes {
            Bytes::Local(file) => return file.read(buffer),
            Bytes::Remote(_) => self.length.saturating_sub(self.at).min(buffer.len() as u64) as usize,
        };
        if length > 0 {
            self.read_at(self.at, &mut buffer[..length])?;
            self.at += length as u64;
        }
        Ok(length)
    }
}

impl Seek for InputFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let (base, step) = match (&mut self.bytes, to) {
            (Bytes::Local(file), to) => return file.seek(to),
            (_, SeekFrom::Start(at)) => (at, 0),
            (_, SeekFrom::End(step)) => (self.length, step),
            (_, SeekFrom::Current(step)) => (self.at, step),
        };
        self.at = base.checked_add_signed(step).ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.at)
    }
}

/// Returns the path of a file next to another one. `name` derives it from the other path without
/// the query of a URL, which is appended again.
pub fn sibling_path(path: &Path, name: impl FnOnce(&Path) -> PathBuf) -> PathBuf {
    let mut named = name(without_query(path)).into_os_string();
    named.push(url_of(path).map_or("", |url| split_query(url).1));
    named.into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::FileAccess;

    #[test]
    fn remote_files_are_read_like_local_ones() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("x");
        let bytes: Vec<u8> = (0..200).collect();
        std::fs::write(&path, &bytes).unwrap();
        let access = FileAccess::new();
        for mut file in [access.input(&path).unwrap(), InputFile::remote(Box::new(bytes.clone()))] {
            assert_eq!(file.len(), 200);
            let mut some = [0; 7];
            file.read_exact(&mut some).unwrap();
            assert_eq!(some, [0, 1, 2, 3, 4, 5, 6]);
            file.read_at(100, &mut some).unwrap();
            assert_eq!(some[..2], [100, 101]);
            assert_eq!(file.seek(SeekFrom::Current(3)).unwrap(), 10);
            assert_eq!(file.seek(SeekFrom::End(-5)).unwrap(), 195);
            let mut rest = Vec::new();
            file.read_to_end(&mut rest).unwrap();
            assert_eq!(rest, [195, 196, 197, 198, 199]);
            assert_eq!(file.seek(SeekFrom::Start(300)).unwrap(), 300);
            assert_eq!(file.read(&mut some).unwrap(), 0);
            assert_eq!(file.read_at(198, &mut some).unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
            assert!(file.seek(SeekFrom::Current(-301)).is_err());
            assert!(file.prefetch(&[0..20, 100..200]).is_ok());
        }
        assert_eq!(access.read_whole(&path, 200).unwrap(), Some(bytes));
        assert!(access.read_whole(&path, 199).is_err());
        assert_eq!(access.read_whole(&directory.path().join("y"), 9).unwrap(), None);
        assert!(access.find_companion(&directory.path().join("y")).unwrap().is_none());
    }

    #[test]
    fn errors_pass_through_io_errors_unchanged() {
        let back = |error| Error::io("x", "read")(Error::into_io(error));
        assert!(matches!(back(Error::Interrupted), Error::Interrupted));
        let changed = Error::Changed { path: "s3://b/x".into(), what: "was overwritten" };
        assert!(matches!(back(changed), Error::Changed { .. }));
        let denied = Error::io("s3://b/x", "open")(io::ErrorKind::PermissionDenied.into());
        assert!(
            is_access_denied(Path::new("s3://b/x"), &denied) && !is_access_denied(Path::new("x"), &denied)
        );
        assert!(matches!(back(denied), Error::Io { doing: "open", .. }));
    }

    #[test]
    fn sibling_names_precede_the_query() {
        let prj = |path: &str| sibling_path(Path::new(path), |path| path.with_extension("prj"));
        assert_eq!(prj("https://h/a.tif?sig=x.y/z").to_str(), Some("https://h/a.prj?sig=x.y/z"));
        assert_eq!(prj("s3://b/a.b.tif").to_str(), Some("s3://b/a.b.prj"));
        assert_eq!(prj("a.tif?x").to_str(), Some("a.prj"));
    }
}

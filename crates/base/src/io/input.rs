//! A file that is read, wherever it is.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::open::remote_files;
use super::platform::read_exact_at;
use super::read::{ReadBackend, open_input};
use crate::url::{local_path, split_query, url_of, without_query};
use crate::{Error, Result};

/// A file of this machine or elsewhere that is read from its beginning on, from another place on, or at places by several threads.
///
/// Errors of a file elsewhere go through [`io::Error`] as they are: [`Error::io`] finds them there.
pub struct InputFile {
    bytes: Bytes,
    length: u64,
    /// Where the next byte of a file elsewhere is read.
    at: u64,
}

enum Bytes {
    Here(File),
    Elsewhere(Box<dyn ReadBackend>),
}

impl InputFile {
    /// Opens a file.
    ///
    /// # Errors
    /// If it is not there, may not be read, or is a pipe or a device.
    pub fn open(path: &Path) -> Result<InputFile> {
        if let Some(url) = url_of(path) {
            let file = remote_files(path)?.open(url, &[])?;
            return Ok(InputFile { length: file.len(), bytes: Bytes::Elsewhere(file), at: 0 });
        }
        let path = &*local_path(path);
        let file = open_input(path)?;
        let length = file.metadata().map_err(Error::io(path, "read the size of"))?.len();
        Ok(InputFile { bytes: Bytes::Here(file), length, at: 0 })
    }

    /// Opens a file, if it is there.
    ///
    /// # Errors
    /// Those of [`InputFile::open`].
    pub fn find(path: &Path) -> Result<Option<InputFile>> {
        match InputFile::open(path) {
            Err(Error::Io { cause, .. }) if cause.kind() == io::ErrorKind::NotFound => Ok(None),
            found => found.map(Some),
        }
    }

    /// Opens a file that may stand beside another one, which could be read, if it is there. Elsewhere one that nobody may read is one that is
    /// not there: stores tell that of it to those who may not list what there is.
    ///
    /// # Errors
    /// Those of [`InputFile::open`].
    pub fn find_beside(path: &Path) -> Result<Option<InputFile>> {
        match InputFile::find(path) {
            Err(error) if is_access_denied(path, &error) => Ok(None),
            found => found,
        }
    }

    /// All bytes of a file of at most so many; `None` if it is not there.
    ///
    /// # Errors
    /// Those of [`InputFile::open`]; also if it has more.
    pub fn read_whole(path: &Path, most: u64) -> Result<Option<Vec<u8>>> {
        let Some(mut file) = InputFile::find(path)? else { return Ok(None) };
        let mut bytes = Vec::new();
        // (Others may be writing it.)
        let read = file.by_ref().take(most.saturating_add(1)).read_to_end(&mut bytes);
        read.map_err(Error::io(path, "read"))?;
        if bytes.len() as u64 > most {
            return Err(Error::corrupt(path, "length", format!("more than {most} bytes"), "fewer"));
        }
        Ok(Some(bytes))
    }

    /// Number of bytes.
    pub fn len(&self) -> u64 {
        self.length
    }

    /// Whether there are no bytes.
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Fills a buffer with the bytes from an offset on, whatever was read last.
    pub fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        match &self.bytes {
            Bytes::Here(file) => read_exact_at(file, buffer, offset),
            Bytes::Elsewhere(file) => {
                let end = offset.checked_add(buffer.len() as u64).filter(|end| *end <= self.length);
                end.ok_or(io::ErrorKind::UnexpectedEof)?;
                let bytes = file.share(offset, buffer.len()).map_err(Error::into_io)?;
                buffer.copy_from_slice(&bytes);
                Ok(())
            }
        }
    }

    /// Says that ranges, which must lie within the length, will be read soon: those of a file elsewhere are fetched all at once, as far as
    /// its cache has room.
    ///
    /// # Errors
    /// If they cannot be fetched.
    pub fn prefetch(&self, ranges: &[Range<u64>]) -> Result<()> {
        match &self.bytes {
            Bytes::Here(_) => Ok(()),
            Bytes::Elsewhere(file) => file.prefetch(ranges),
        }
    }

    /// Whether the file is elsewhere, so that each read of something else takes a request.
    pub fn is_remote(&self) -> bool {
        matches!(self.bytes, Bytes::Elsewhere(_))
    }
}

/// Whether an error says of a file elsewhere that nobody may look at it.
pub(super) fn is_access_denied(path: &Path, error: &Error) -> bool {
    let is_denied =
        matches!(error, Error::Io { cause, .. } if cause.kind() == io::ErrorKind::PermissionDenied);
    is_denied && url_of(path).is_some()
}

impl Read for InputFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let length = match &mut self.bytes {
            Bytes::Here(file) => return file.read(buffer),
            Bytes::Elsewhere(_) => self.length.saturating_sub(self.at).min(buffer.len() as u64) as usize,
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
            (Bytes::Here(file), to) => return file.seek(to),
            (_, SeekFrom::Start(at)) => (at, 0),
            (_, SeekFrom::End(step)) => (self.length, step),
            (_, SeekFrom::Current(step)) => (self.at, step),
        };
        self.at = base.checked_add_signed(step).ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.at)
    }
}

/// The path of a file beside another one, which `name` makes of that one's; a query of a URL stays behind it.
pub fn beside(path: &Path, name: impl FnOnce(&Path) -> PathBuf) -> PathBuf {
    let mut named = name(without_query(path)).into_os_string();
    named.push(url_of(path).map_or("", |url| split_query(url).1));
    named.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file elsewhere of some bytes.
    fn elsewhere(bytes: &[u8]) -> InputFile {
        let length = bytes.len() as u64;
        InputFile { bytes: Bytes::Elsewhere(Box::new(bytes.to_vec())), length, at: 0 }
    }

    #[test]
    fn files_here_and_elsewhere_are_read_alike() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        let bytes: Vec<u8> = (0..200).collect();
        std::fs::write(&path, &bytes).unwrap();
        for mut file in [InputFile::open(&path).unwrap(), elsewhere(&bytes)] {
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
        assert_eq!(InputFile::read_whole(&path, 200).unwrap(), Some(bytes));
        assert!(InputFile::read_whole(&path, 199).is_err());
        assert_eq!(InputFile::read_whole(&folder.path().join("y"), 9).unwrap(), None);
        assert!(InputFile::find_beside(&folder.path().join("y")).unwrap().is_none());
    }

    #[test]
    fn errors_stay_what_they_are() {
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
    fn names_beside_are_before_the_query() {
        let prj = |path: &str| beside(Path::new(path), |path| path.with_extension("prj"));
        assert_eq!(prj("https://h/a.tif?sig=x.y/z").to_str(), Some("https://h/a.prj?sig=x.y/z"));
        assert_eq!(prj("s3://b/a.b.tif").to_str(), Some("s3://b/a.b.prj"));
        assert_eq!(prj("a.tif?x").to_str(), Some("a.prj"));
    }
}

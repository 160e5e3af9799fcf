//! Opening files wherever they are: on this machine, or elsewhere by a URL.

use std::io::Write;
use std::path::Path;
use std::sync::OnceLock;

use super::file_id::FileId;
use super::read::{Mapped, Positioned, ReadBackend, open_input};
use super::stat::FileStat;
use crate::url::{local_path, url_of};
use crate::{Error, Result};

/// The way to files that are elsewhere.
pub trait RemoteFiles: Send + Sync {
    /// A file to be read.
    ///
    /// # Errors
    /// If it cannot be reached, or not in ranges.
    fn open(&self, url: &str, options: &[(String, String)]) -> Result<Box<dyn ReadBackend>>;

    /// States of files, in their order, all of which are asked for at the same time; nothing of those that are not there.
    ///
    /// # Errors
    /// On interruption. Of each file, if its host does not tell.
    fn stat(&self, urls: &[&str]) -> Result<Vec<Result<Option<FileStat>>>>;

    /// Starts a file, which appears whole or not at all.
    ///
    /// # Errors
    /// If the URL leads nowhere.
    fn write(&self, url: &str) -> Result<Box<dyn RemoteWriter>>;

    /// Removes files, those that are there.
    ///
    /// # Errors
    /// If that fails for one of them.
    fn remove(&self, urls: &[&str]) -> Result<()>;
}

/// A file elsewhere being written, from its beginning on. Dropping it leaves nothing. Errors are of this library, inside of those of the system.
pub trait RemoteWriter: Write + Send {
    /// Says how many bytes there will be, about, where that is known before the first one.
    fn expect(&mut self, bytes: u64);

    /// Puts the file in its place; also where there is another one, unless it must be new.
    ///
    /// # Errors
    /// If that fails; nothing is left there then.
    fn commit(self: Box<Self>, create_new: bool) -> Result<()>;
}

static REMOTE_FILES: OnceLock<Box<dyn RemoteFiles>> = OnceLock::new();

/// Says how files that are elsewhere are reached, once in a process.
pub fn set_remote_files(files: Box<dyn RemoteFiles>) {
    // (A second one is as good as the first.)
    let _ = REMOTE_FILES.set(files);
}

/// The way to a file that is elsewhere.
///
/// # Errors
/// If nobody has said how.
pub(super) fn remote_files(path: &Path) -> Result<&'static dyn RemoteFiles> {
    REMOTE_FILES.get().map(|files| &**files).ok_or_else(|| {
        let advice = "use a build with support for remote files, or copy the file to this machine";
        Error::unsupported(path, "a remote file", advice)
    })
}

/// The bytes of a file, and which file it is: two looks at a path may see two files. Those of this machine are mapped, or read at
/// positions; `options` are those of the store of a file elsewhere, such as credentials.
///
/// # Errors
/// If the file cannot be opened.
pub fn open_file(
    path: &Path,
    positioned: bool,
    options: &[(String, String)],
) -> Result<(Box<dyn ReadBackend>, FileId)> {
    if let Some(url) = url_of(path) {
        return Ok((remote_files(path)?.open(url, options)?, FileId::unique()));
    }
    let path = &*local_path(path);
    let file = open_input(path)?;
    let id = FileId::of(&file).map_err(Error::io(path, "open"))?;
    let backend: Box<dyn ReadBackend> =
        if positioned { Box::new(Positioned::of(file, path)?) } else { Box::new(Mapped::of(&file, path)?) };
    Ok((backend, id))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_knows_no_servers_says_so() {
        let error = open_file(Path::new("https://host/x"), false, &[]).err().unwrap();
        assert!(matches!(error, Error::Unsupported { .. }), "{error}");
    }
}

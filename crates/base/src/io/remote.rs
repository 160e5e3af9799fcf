//! Interface of clients for remote files.

use std::io::Write;

use super::access::FileAccess;
use super::read::ReadBackend;
use super::stat::FileStat;
use crate::Result;

/// Client for remote files. A [`FileAccess`] has one, and passes itself where bytes are read or written.
pub trait RemoteFiles: Send + Sync {
    /// Opens a file, whose bytes go to the [cache of ranges](FileAccess::ranges) of `access`.
    ///
    /// # Errors
    /// If it cannot be reached, or not in ranges.
    fn open(
        &self,
        url: &str,
        options: &[(String, String)],
        access: &FileAccess,
    ) -> Result<Box<dyn ReadBackend>>;

    /// Stats files, in their order, all at the same time; `None` for missing ones.
    ///
    /// # Errors
    /// On cancellation. Of each file, if its host refuses.
    fn stat(&self, urls: &[&str]) -> Result<Vec<Result<Option<FileStat>>>>;

    /// Starts a file, which appears whole or not at all.
    ///
    /// # Errors
    /// If the URL leads nowhere.
    fn write(&self, url: &str, access: &FileAccess) -> Result<Box<dyn RemoteWriter>>;

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

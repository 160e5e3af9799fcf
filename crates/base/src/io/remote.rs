//! Interface of clients for remote files.

use std::io::Write;

use super::access::FileAccess;
use super::read::ReadBackend;
use super::stat::FileStat;
use crate::{Error, Result};

/// Client for remote files. A [`FileAccess`] holds one, and passes itself to calls that read or
/// write.
pub trait RemoteFiles: Send + Sync {
    /// Opens a file. Its bytes are stored in the [cache of remote ranges](FileAccess::ranges) of
    /// `access`.
    ///
    /// # Errors
    /// If the file cannot be reached, or does not support range requests.
    fn open(
        &self,
        url: &str,
        options: &[(String, String)],
        access: &FileAccess,
    ) -> Result<Box<dyn ReadBackend>>;

    /// Returns a file whose length and version are known, without a request. If responses name
    /// another version, a warning is given once, and the file is read nevertheless: callers compare
    /// what they read with checksums.
    ///
    /// # Errors
    /// If the URL is invalid.
    fn open_known(&self, url: &str, known: &FileStat, access: &FileAccess) -> Result<Box<dyn ReadBackend>> {
        let _ = known;
        self.open(url, &[], access)
    }

    /// Stats files concurrently, and returns the results in order; `None` for missing ones.
    ///
    /// # Errors
    /// On cancellation. Per file, if its host refuses.
    fn stat(&self, urls: &[&str]) -> Result<Vec<Result<Option<FileStat>>>>;

    /// Lists the files of a store whose URLs start with a prefix, in any order. If not `is_deep`,
    /// only those without another `/` after it.
    ///
    /// # Errors
    /// If the host cannot list files, or there are more than [`MAX_NAMES`](super::MAX_NAMES) names;
    /// on cancellation.
    fn list(&self, prefix: &str, is_deep: bool) -> Result<Vec<String>> {
        let _ = is_deep;
        let advice = "give the names of the files, or a list of these (@FILE)";
        Err(Error::unsupported(prefix, "a pattern of files on a host that cannot list them", advice))
    }

    /// Starts a file, which appears whole or not at all.
    ///
    /// # Errors
    /// If the URL is invalid.
    fn write(&self, url: &str, access: &FileAccess) -> Result<Box<dyn RemoteWriter>>;

    /// Removes files. Missing ones count as removed.
    ///
    /// # Errors
    /// If a file cannot be removed.
    fn remove(&self, urls: &[&str]) -> Result<()>;
}

/// A remote file that is written sequentially. Dropping it without a commit leaves no file.
///
/// Errors are those of this library, wrapped by [`Error::into_io`](crate::Error::into_io).
pub trait RemoteWriter: Write + Send {
    /// Announces the approximate size in bytes, if it is known before the first byte is written.
    fn expect(&mut self, bytes: u64);

    /// Puts the file in place. Replaces an existing one, or fails if `create_new` is set.
    ///
    /// # Errors
    /// If that fails; no new file is left then.
    fn commit(self: Box<Self>, create_new: bool) -> Result<()>;
}

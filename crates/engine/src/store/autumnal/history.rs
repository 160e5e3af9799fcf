//! Commits of a file.

use std::path::Path;

use super::archive::Archive;
use super::commit::Commit;
use spinney_base::Result;
use spinney_base::io::FileAccess;
use spinney_container::{FileReference, OpenOptions};

/// Commits of a file, up to the newest at the time of opening.
pub struct History {
    pub(super) archive: Archive,
}

impl History {
    /// Opens a file.
    ///
    /// # Errors
    /// If it cannot be read, is not an Autumnal file, or is corrupt.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<History> {
        let path = &*FileReference::of(path).file;
        Ok(History { archive: Archive::open(path, &|| options.open_with_id(path), options)? })
    }

    /// Returns the options that the file was opened with.
    pub fn access(&self) -> &FileAccess {
        &self.archive.access
    }

    /// Checks that the newest commit can be read.
    ///
    /// # Errors
    /// If it is corrupt and only older commits can be read.
    pub fn check_newest(&self) -> Result<()> {
        self.archive.state.check(&self.archive.extents)
    }

    /// Checks that the file still has the commits: see
    /// [`Autumnal::check_unchanged`](super::Autumnal::check_unchanged).
    ///
    /// # Errors
    /// If it does not.
    pub fn check_unchanged(&self) -> Result<()> {
        self.archive.check_unchanged()
    }

    /// Returns a remark on the file for its users.
    pub fn remark(&self) -> Option<&'static str> {
        self.archive.remark()
    }

    /// Returns whether equal subtrees are stored once.
    pub fn is_shared(&self) -> bool {
        self.archive.form.share
    }

    /// Finds the commit with a number. Reads a number of commits that is logarithmic in the commit
    /// count.
    ///
    /// # Errors
    /// If there is no such commit, or the file is corrupt.
    pub fn commit(&self, number: u64) -> Result<Commit> {
        self.archive.commit(number)
    }

    /// Returns all commits, the newest first. If newer commits are corrupt, the last item is an
    /// error that says so.
    pub fn commits(&self) -> impl Iterator<Item = Result<Commit>> + '_ {
        let mut next = Some(self.archive.meta.commit);
        let commits = std::iter::from_fn(move || {
            let commit = Commit::read(&self.archive.extents, next.take()?);
            // There is no next commit after an error.
            next = commit.as_ref().ok().map(|commit| commit.previous).filter(|previous| *previous != 0);
            Some(commit)
        });
        commits.chain(self.check_newest().err().map(Err))
    }
}

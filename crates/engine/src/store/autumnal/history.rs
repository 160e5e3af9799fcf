//! The commits of a file.

use std::path::Path;

use super::archive::Archive;
use super::commit::Commit;
use spinney_base::Result;
use spinney_base::io::FileAccess;
use spinney_container::{FileReference, OpenOptions};

/// The commits of a file, up to the one that was the newest when it was opened.
pub struct History {
    pub(super) archive: Archive,
}

impl History {
    /// Opens a file.
    ///
    /// # Errors
    /// If it cannot be read, is no Autumnal file, or is damaged.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<History> {
        let path = &*FileReference::of(path).file;
        Ok(History { archive: Archive::open(path, &|| options.open_with_id(path), options)? })
    }

    /// How the file was opened.
    pub fn access(&self) -> &FileAccess {
        &self.archive.access
    }

    /// Makes sure that the newest commit can be read.
    ///
    /// # Errors
    /// If it is damaged, and those that can be read are older.
    pub fn check_newest(&self) -> Result<()> {
        self.archive.newest.check(&self.archive.extents)
    }

    /// Makes sure that the file still has the commits: see [`Autumnal::check_unchanged`](super::Autumnal::check_unchanged).
    ///
    /// # Errors
    /// If it has not.
    pub fn check_unchanged(&self) -> Result<()> {
        self.archive.check_unchanged()
    }

    /// A remark on the file that whoever reads it should know.
    pub fn remark(&self) -> Option<&'static str> {
        self.archive.remark()
    }

    /// Whether equal subtrees are stored once.
    pub fn is_shared(&self) -> bool {
        self.archive.form.share
    }

    /// The commit with a number, found in a number of steps that grows with the logarithm of the number of
    /// commits.
    ///
    /// # Errors
    /// If there is none, or the file is damaged.
    pub fn commit(&self, number: u64) -> Result<Commit> {
        self.archive.commit(number)
    }

    /// All commits, the newest first. Where newer ones are damaged, an error comes last that says so.
    pub fn commits(&self) -> impl Iterator<Item = Result<Commit>> + '_ {
        let mut next = Some(self.archive.meta.commit);
        let commits = std::iter::from_fn(move || {
            let commit = Commit::read(&self.archive.extents, next.take()?);
            // After an error there is no next one.
            next = commit.as_ref().ok().map(|commit| commit.previous).filter(|previous| *previous != 0);
            Some(commit)
        });
        commits.chain(self.check_newest().err().map(Err))
    }
}

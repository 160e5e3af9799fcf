//! The commits of a file.

use std::fs::File;
use std::path::Path;

use super::archive::Archive;
use super::commit::Commit;
use super::medium::FileId;
use crate::store::goblin::{Header, OpenOptions};
use crate::{Error, Result};

/// The commits of a file, up to the one that was the newest when it was opened.
pub struct History {
    pub(super) archive: Archive,
}

impl History {
    /// Opens a file, whatever its tree is made of.
    ///
    /// # Errors
    /// If it cannot be read, is no Autumnal file, or is damaged.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<History> {
        let id = File::open(path).and_then(|file| FileId::of(&file)).map_err(Error::io(path, "open"))?;
        Ok(History { archive: Archive::open(path, || options.storage(path), id, options.check)? })
    }

    /// What the header says.
    pub fn header(&self) -> &Header {
        &self.archive.header
    }

    /// Whether equal subtrees are stored once.
    pub fn is_shared(&self) -> bool {
        self.archive.share
    }

    /// The commit with a number, found in a number of steps that grows with the logarithm of the number of commits.
    ///
    /// # Errors
    /// If there is none, or the file is damaged.
    pub fn commit(&self, number: u64) -> Result<Commit> {
        self.archive.commit(number)
    }

    /// All commits, the newest first.
    pub fn commits(&self) -> impl Iterator<Item = Result<Commit>> + '_ {
        let mut next = Some(self.archive.meta.commit);
        std::iter::from_fn(move || {
            let commit = Commit::read(&self.archive.extents, next.take()?);
            next = commit.as_ref().ok().map(|commit| commit.previous).filter(|previous| *previous != 0);
            Some(commit)
        })
    }
}

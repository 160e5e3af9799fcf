//! Existence, length and version of files.

use std::fs::{File, Metadata};
use std::io::ErrorKind;
use std::path::Path;
use std::time::UNIX_EPOCH;

use serde::{Deserialize, Serialize};

use crate::{Error, Result};

/// Identity of a file version: equal values imply equal contents.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileStat {
    /// Length in bytes.
    pub length: u64,
    /// Version of the file.
    pub version: FileVersion,
}

/// Version of a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FileVersion {
    /// Modification time of a local file, in nanoseconds since 1970-01-01T00:00:00Z.
    Modified(i64),
    /// The entity tag (ETag) of a remote file, or what its host sends instead.
    Tag(String),
}

impl FileStat {
    /// Returns whether another status may be that of the same version: lengths are equal, and so
    /// are versions, unless one is that of a local file and the other that of a remote one.
    pub fn agrees(&self, other: &FileStat) -> bool {
        let are_alike = std::mem::discriminant(&self.version) == std::mem::discriminant(&other.version);
        self.length == other.length && (!are_alike || self.version == other.version)
    }

    /// Returns the version of an open local file.
    pub(super) fn of(file: &File, path: &Path) -> Result<FileStat> {
        FileStat::from_metadata(&file.metadata().map_err(Error::io(path, "stat"))?, path)
    }

    fn from_metadata(found: &Metadata, path: &Path) -> Result<FileStat> {
        let modified = found.modified().map_err(Error::io(path, "stat"))?;
        let modified = match modified.duration_since(UNIX_EPOCH) {
            Ok(since) => i64::try_from(since.as_nanos()).unwrap_or(i64::MAX),
            Err(before) => i64::try_from(before.duration().as_nanos()).map_or(i64::MIN, |nanos| -nanos),
        };
        Ok(FileStat { length: found.len(), version: FileVersion::Modified(modified) })
    }
}

/// Stats a local file; `None` if it is missing.
pub(super) fn stat_local(path: &Path) -> Result<Option<FileStat>> {
    let found = match std::fs::metadata(path) {
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            return Ok(None);
        }
        found => found.map_err(Error::io(path, "stat"))?,
    };
    FileStat::from_metadata(&found, path).map(Some)
}

/// Removes a local file. A missing one counts as removed.
pub(super) fn remove_local(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(()),
        done => done.map_err(Error::io(path, "remove")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::FileAccess;

    #[test]
    fn files_of_this_machine_have_a_time_until_they_are_removed() {
        let access = FileAccess::new();
        let directory = tempfile::tempdir().unwrap();
        let [one, none] = ["one", "one/none"].map(|name| directory.path().join(name));
        std::fs::write(&one, "123").unwrap();
        let found = access.stat(&[&none, &one]).unwrap();
        assert!(matches!(&found[0], Ok(None)));
        let state = found[1].as_ref().unwrap().clone().unwrap();
        assert!(state.length == 3 && matches!(state.version, FileVersion::Modified(time) if time > 0));
        assert_eq!(access.stat_companions(&[&one]).unwrap(), [Some(state)]);
        access.remove(&[&none, &one, &one]).unwrap();
        assert_eq!(access.stat_companions(&[&one]).unwrap(), [None]);
        assert!(access.remove(&[directory.path()]).is_err());
    }
}

//! Existence, length and version of files, and their removal, local and remote.

use std::io::ErrorKind;
use std::path::Path;
use std::time::UNIX_EPOCH;

use super::input::is_access_denied;
use super::open::remote_files;
use crate::url::{local_path, url_of};
use crate::{Error, Result};

/// Identity of a file version: equal values imply equal contents.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileStat {
    /// Bytes.
    pub length: u64,
    /// Version of the file.
    pub version: FileVersion,
}

/// Version of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FileVersion {
    /// Modification time of a local file, in nanoseconds since 1970-01-01T00:00:00Z.
    Modified(i64),
    /// The entity tag (ETag) of a remote file, or what its host sends instead.
    Tag(String),
}

impl FileStat {
    /// Stats a file; `None` if there is none.
    ///
    /// # Errors
    /// If its host or the file system refuses.
    pub fn of(path: &Path) -> Result<Option<FileStat>> {
        FileStat::of_all(&[path])?.pop().expect("as many as were asked for")
    }

    /// Stats files, in their order; `None` for missing ones. Remote files are queried all at once.
    ///
    /// # Errors
    /// If remote files are not enabled, or on cancellation. Of each file, if its host or the file system refuses.
    pub fn of_all(paths: &[&Path]) -> Result<Vec<Result<Option<FileStat>>>> {
        let urls: Vec<&str> = paths.iter().filter_map(|path| url_of(path)).collect();
        let mut far = match urls.first() {
            Some(first) => remote_files(Path::new(first))?.stat(&urls)?.into_iter(),
            None => Vec::new().into_iter(),
        };
        let state = |path: &&Path| match url_of(path) {
            Some(_) => far.next().expect("as many as were asked for"),
            None => here(&local_path(path)),
        };
        Ok(paths.iter().map(state).collect())
    }

    /// Stats files that may accompany others, which could be read: see [`InputFile::find_beside`](super::InputFile::find_beside).
    ///
    /// # Errors
    /// If one cannot be looked at.
    pub fn of_all_beside(paths: &[&Path]) -> Result<Vec<Option<FileStat>>> {
        let found = paths.iter().zip(FileStat::of_all(paths)?);
        let found = found.map(|(path, found)| match found {
            Err(error) if is_access_denied(path, &error) => Ok(None),
            found => found,
        });
        found.collect()
    }
}

fn here(path: &Path) -> Result<Option<FileStat>> {
    let about = || Error::io(path, "look at");
    let found = match std::fs::metadata(path) {
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            return Ok(None);
        }
        found => found.map_err(about())?,
    };
    let modified = found.modified().map_err(about())?;
    let modified = match modified.duration_since(UNIX_EPOCH) {
        Ok(since) => i64::try_from(since.as_nanos()).unwrap_or(i64::MAX),
        Err(before) => i64::try_from(before.duration().as_nanos()).map_or(i64::MIN, |nanos| -nanos),
    };
    Ok(Some(FileStat { length: found.len(), version: FileVersion::Modified(modified) }))
}

/// Removes files. One that is not there is removed already.
///
/// # Errors
/// If one cannot be removed, or on interruption; others may be removed then.
pub fn remove_files(paths: &[&Path]) -> Result<()> {
    let urls: Vec<&str> = paths.iter().filter_map(|path| url_of(path)).collect();
    if let Some(first) = urls.first() {
        remote_files(Path::new(first))?.remove(&urls)?;
    }
    for path in paths.iter().filter(|path| url_of(path).is_none()) {
        let path = &*local_path(path);
        match std::fs::remove_file(path) {
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {}
            done => done.map_err(Error::io(path, "remove"))?,
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_this_machine_have_a_time_until_they_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let [one, none] = ["one", "one/none"].map(|name| folder.path().join(name));
        std::fs::write(&one, "123").unwrap();
        let found = FileStat::of_all(&[&none, &one]).unwrap();
        assert!(matches!(&found[0], Ok(None)));
        let state = found[1].as_ref().unwrap().clone().unwrap();
        assert!(state.length == 3 && matches!(state.version, FileVersion::Modified(time) if time > 0));
        assert_eq!(FileStat::of(&one).unwrap(), Some(state));
        remove_files(&[&none, &one, &one]).unwrap();
        assert_eq!(FileStat::of(&one).unwrap(), None);
        assert!(remove_files(&[folder.path()]).is_err());
    }

    #[test]
    fn who_knows_no_hosts_says_so() {
        assert!(
            FileStat::of(Path::new("s3://b/x")).is_err() && remove_files(&[Path::new("s3://b/x")]).is_err()
        );
    }
}

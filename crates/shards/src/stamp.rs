//! Whether files are those that were there when a job was planned.

use std::collections::HashSet;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use serde::{Deserialize, Serialize};
use spinney_base::io::{local_path, url_of};
use spinney_base::{Error, Result};

use crate::work::Work;

/// A file that a plan knows.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlannedFile {
    /// The file's name, from the root of the file system on.
    pub(crate) path: PathBuf,
    /// Its bytes.
    pub(crate) bytes: u64,
    /// The time of its last change, in nanoseconds since the beginning of 1970.
    modified: i64,
}

impl PlannedFile {
    /// The file as it is; nothing if there is none.
    fn look(path: &Path) -> Result<Option<PlannedFile>> {
        let about = || Error::io(path, "look at");
        let found = match fs::metadata(path) {
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
        Ok(Some(PlannedFile { path: path.to_path_buf(), bytes: found.len(), modified }))
    }

    fn described(&self) -> String {
        format!("{} bytes, changed {} ns after 1970", self.bytes, self.modified)
    }
}

/// A path from the root of the file system on, so that it means the same to whoever works in another folder.
///
/// # Errors
/// If it is one of a file elsewhere, or standard input.
pub(crate) fn absolute(path: &Path) -> Result<PathBuf> {
    let path = &*local_path(path);
    if url_of(path).is_some() {
        return Err(Error::unsupported(path, "a file elsewhere", "copy it to this machine first"));
    }
    if path == Path::new("-") {
        return Err(Error::unsupported(
            path,
            "standard input",
            "write it to a file that all shards can read",
        ));
    }
    std::path::absolute(path).map_err(Error::io(path, "look at"))
}

/// Those of some files that are there, each once.
///
/// # Errors
/// If one cannot be looked at.
pub(crate) fn look(files: Vec<PathBuf>) -> Result<Vec<PlannedFile>> {
    let mut known = HashSet::new();
    // (A source's path is relative to the file that names it, which is absolute.)
    let once = files.into_iter().filter(|path| known.insert(path.clone()));
    let found: Result<Vec<_>> = once.map(|path| PlannedFile::look(&path)).collect();
    Ok(found?.into_iter().flatten().collect())
}

/// Makes sure that the files that reading an input looks at are those of a plan, and no others.
///
/// # Errors
/// If a file has changed, has gone or has come.
pub(crate) fn check(input: &Path, work: &dyn Work, planned: &[PlannedFile]) -> Result<()> {
    let differs = |path: &Path, found: Option<PlannedFile>, expected: String| Error::NotPlanned {
        path: path.to_path_buf(),
        found: found.map_or("there is no such file".into(), |found| format!("has {}", found.described())),
        expected,
        advice: "a shard is made of the planned files alone: put this one back as it was, with its time, or plan another job",
    };
    // (Before the files are read to know what else belongs to them.)
    for file in planned {
        let found = PlannedFile::look(&file.path)?;
        if found.as_ref() != Some(file) {
            return Err(differs(&file.path, found, file.described()));
        }
    }
    let known: HashSet<&Path> = planned.iter().map(|file| &*file.path).collect();
    for path in work.files_of(input)?.into_iter().filter(|path| !known.contains(&**path)) {
        if let found @ Some(_) = PlannedFile::look(&path)? {
            return Err(differs(&path, found, "no such file".into()));
        }
    }
    Ok(())
}

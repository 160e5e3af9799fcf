//! Checks that files are unchanged since a job was planned.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::{FileAccess, FileStat, FileVersion, local_path, url_of};
use spinney_base::{Error, Result};

use crate::job::PlannedInput;
use crate::work::Work;

/// File recorded in a plan.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlannedFile {
    /// Absolute path, or URL.
    pub(crate) path: PathBuf,
    /// Length in bytes.
    pub(crate) bytes: u64,
    /// Modification time of a local file, in nanoseconds since the beginning of 1970.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    modified: Option<i64>,
    /// Entity tag of a remote file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    tag: Option<String>,
}

impl PlannedFile {
    fn of(path: &Path, state: FileStat) -> PlannedFile {
        let (path, bytes) = (path.to_path_buf(), state.length);
        match state.version {
            FileVersion::Modified(time) => PlannedFile { path, bytes, modified: Some(time), tag: None },
            FileVersion::Tag(tag) => PlannedFile { path, bytes, modified: None, tag: Some(tag) },
        }
    }

    fn described(&self) -> String {
        let bytes = self.bytes;
        match (&self.tag, self.modified) {
            (Some(tag), _) => format!("{bytes} bytes with tag {tag}"),
            (None, time) => format!("{bytes} bytes, modified {} ns after 1970", time.unwrap_or_default()),
        }
    }
}

/// Absolute path or URL, valid for processes with another working directory.
///
/// # Errors
/// If it is standard input.
pub(crate) fn absolute(path: &Path) -> Result<PathBuf> {
    let path = &*local_path(path);
    if url_of(path).is_some() {
        return Ok(path.to_path_buf());
    }
    if path == Path::new("-") {
        return Err(Error::unsupported(
            path,
            "a shard job of standard input",
            "save it to a file that all shards can read",
        ));
    }
    std::path::absolute(path).map_err(Error::io(path, "resolve"))
}

/// Stats the files of each input that exist, without duplicates.
///
/// # Errors
/// If a file cannot be stat'ed.
pub(crate) fn stat_inputs(files: Vec<Vec<PathBuf>>, access: &FileAccess) -> Result<Vec<Vec<PlannedFile>>> {
    let once: Vec<Vec<&Path>> = files.iter().map(|files| once(files)).collect();
    // The files of all inputs go into one call, which batches the remote requests.
    let mut states = access.stat_companions(&once.concat())?.into_iter();
    let mut planned = |path: &&Path| Some(PlannedFile::of(path, states.next().flatten()?));
    Ok(once.iter().map(|paths| paths.iter().filter_map(&mut planned).collect()).collect())
}

/// Paths without duplicates. (A source's path is relative to the file that names it, which is
/// absolute.)
fn once(files: &[PathBuf]) -> Vec<&Path> {
    let mut known = HashSet::new();
    files.iter().filter(|path| known.insert(*path)).map(|path| &**path).collect()
}

/// Checks that reading the inputs involves exactly the planned files, unchanged.
///
/// # Errors
/// If a file has changed, is missing or is new.
pub(crate) fn check(inputs: &[&PlannedInput], work: &dyn Work, access: &FileAccess) -> Result<()> {
    let differs = |path: &Path, found: Option<PlannedFile>, expected: String| Error::PlanMismatch {
        path: path.to_path_buf(),
        found: found.map_or("there is no such file".into(), |found| format!("has {}", found.described())),
        expected,
        advice: "shards need the planned files: restore this one, with its modification time, or plan another job",
    };
    // Known files are checked first, before they are read to find further files.
    let files: Vec<&PlannedFile> = inputs.iter().flat_map(|input| &input.files).collect();
    let paths: Vec<&Path> = files.iter().map(|file| &*file.path).collect();
    for (file, state) in files.iter().zip(access.stat(&paths)?) {
        let found = state?.map(|state| PlannedFile::of(&file.path, state));
        if found.as_ref() != Some(*file) {
            return Err(differs(&file.path, found, file.described()));
        }
    }
    let mut others = Vec::new();
    for input in inputs {
        let known: HashSet<&Path> = input.files.iter().map(|file| &*file.path).collect();
        others
            .extend(work.files_of(&input.path, access)?.into_iter().filter(|path| !known.contains(&**path)));
    }
    let paths: Vec<&Path> = others.iter().map(|path| &**path).collect();
    for (path, state) in paths.iter().zip(access.stat_companions(&paths)?) {
        if let Some(state) = state {
            return Err(differs(path, Some(PlannedFile::of(path, state)), "no such file".into()));
        }
    }
    Ok(())
}

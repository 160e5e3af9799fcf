//! Whether files are those that were there when a job was planned.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use spinney_base::io::{FileAccess, FileStat, FileVersion, local_path, url_of};
use spinney_base::{Error, Result};

use crate::job::PlannedInput;
use crate::work::Work;

/// A file that a plan knows.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlannedFile {
    /// The file's name, from the root of the file system on, or its URL.
    pub(crate) path: PathBuf,
    /// Its bytes.
    pub(crate) bytes: u64,
    /// The time of its last change, in nanoseconds since the beginning of 1970, if it is here.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    modified: Option<i64>,
    /// The tag of its state, if it is elsewhere.
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
            (None, time) => format!("{bytes} bytes, changed {} ns after 1970", time.unwrap_or_default()),
        }
    }
}

/// A path from the root of the file system on, or a URL, so that it means the same to whoever works in another folder.
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
            "standard input",
            "write it to a file that all shards can read",
        ));
    }
    std::path::absolute(path).map_err(Error::io(path, "look at"))
}

/// The files of each input that are there, each once.
///
/// # Errors
/// If one cannot be looked at.
pub(crate) fn look(files: Vec<Vec<PathBuf>>, access: &FileAccess) -> Result<Vec<Vec<PlannedFile>>> {
    let once: Vec<Vec<&Path>> = files.iter().map(|files| once(files)).collect();
    // (Those of all inputs together, since files elsewhere are asked for all at once.)
    let mut states = access.stat_companions(&once.concat())?.into_iter();
    let mut planned = |path: &&Path| Some(PlannedFile::of(path, states.next().flatten()?));
    Ok(once.iter().map(|paths| paths.iter().filter_map(&mut planned).collect()).collect())
}

/// Paths, each once. (A source's path is relative to the file that names it, which is absolute.)
fn once(files: &[PathBuf]) -> Vec<&Path> {
    let mut known = HashSet::new();
    files.iter().filter(|path| known.insert(*path)).map(|path| &**path).collect()
}

/// Makes sure that the files that reading inputs looks at are those of a plan, and no others.
///
/// # Errors
/// If a file has changed, has gone or has come.
pub(crate) fn check(inputs: &[&PlannedInput], work: &dyn Work, access: &FileAccess) -> Result<()> {
    let differs = |path: &Path, found: Option<PlannedFile>, expected: String| Error::PlanMismatch {
        path: path.to_path_buf(),
        found: found.map_or("there is no such file".into(), |found| format!("has {}", found.described())),
        expected,
        advice: "a shard is made of the planned files alone: put this one back as it was, with its time, or plan another job",
    };
    // (Before the files are read to know what else belongs to them.)
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

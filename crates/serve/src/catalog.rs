//! Lookup of files by name. Only the tree files of one directory, or a single file, can be found.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs::Metadata;
use std::path::{Component, Path, PathBuf};

use spinney_base::{Error, Result};

use crate::failure::Failure;

/// File extensions of tree files.
const ENDINGS: [&str; 2] = ["goblin", "autumn"];

/// Served files.
pub(crate) enum Catalog {
    /// Tree files of a directory, whose path has no symbolic links.
    Directory(PathBuf),
    /// Single file.
    File(PathBuf),
}

/// Served file.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct ServedFile {
    /// Name in queries: the stem, or the entire file name if the stem is ambiguous.
    pub(crate) name: String,
    pub(crate) file: String,
    pub(crate) bytes: u64,
}

impl Catalog {
    /// Catalog of a directory's tree files, or of one file.
    ///
    /// # Errors
    /// If there is no such file or directory, or the file name is not UTF-8.
    pub(crate) fn new(path: &Path) -> Result<Catalog> {
        let metadata = std::fs::metadata(path).map_err(Error::io(path, "open"))?;
        if metadata.is_dir() {
            return Ok(Catalog::Directory(path.canonicalize().map_err(Error::io(path, "open"))?));
        }
        if path.file_name().and_then(OsStr::to_str).is_none() {
            return Err(Error::unsupported(path, "a file name that is not UTF-8", "rename the file"));
        }
        Ok(Catalog::File(std::path::absolute(path).map_err(Error::io(path, "open"))?))
    }

    /// Directory of the files.
    pub(crate) fn directory(&self) -> &Path {
        match self {
            Catalog::Directory(directory) => directory,
            Catalog::File(file) => file.parent().unwrap_or(file),
        }
    }

    /// Path of a file by its file name.
    pub(crate) fn file(&self, name: &str) -> Result<PathBuf, Failure> {
        self.find(name).ok_or_else(|| missing(name))
    }

    /// Path of a file by its name in queries: its stem or its file name.
    pub(crate) fn tree(&self, name: &str) -> Result<PathBuf, Failure> {
        if let Some(path) = self.find(name) {
            return Ok(path);
        }
        if let Catalog::File(path) = self {
            let is_stem = path.file_stem().and_then(OsStr::to_str) == Some(name);
            return if is_stem && path.is_file() { Ok(path.clone()) } else { Err(missing(name)) };
        }
        let [goblin, autumn] = ENDINGS.map(|ending| self.find(&format!("{name}.{ending}")));
        match (goblin, autumn) {
            (Some(_), Some(_)) => Err(Failure::missing(format!(
                "`{name}`: is the name of two files; request {name}.goblin or {name}.autumn"
            ))),
            (Some(path), None) | (None, Some(path)) => Ok(path),
            (None, None) => Err(missing(name)),
        }
    }

    /// Path of a file by its file name, if it is served.
    fn find(&self, name: &str) -> Option<PathBuf> {
        match self {
            Catalog::File(path) => {
                let is_name = path.file_name().and_then(OsStr::to_str) == Some(name);
                (is_name && path.is_file()).then(|| path.clone())
            }
            Catalog::Directory(directory) => {
                let path = directory.join(served_name(name)?);
                let metadata = path.symlink_metadata().ok()?;
                follow(directory, path, &metadata).map(|(path, _)| path)
            }
        }
    }

    /// All served files, sorted by file name.
    ///
    /// # Errors
    /// If the directory cannot be read.
    pub(crate) fn list(&self) -> Result<Vec<ServedFile>> {
        let files: BTreeMap<String, u64> = match self {
            Catalog::File(path) => {
                let metadata = path.metadata().map_err(Error::io(path, "stat"))?;
                let name = path.file_name().and_then(OsStr::to_str).unwrap_or_default();
                let name = name.to_owned();
                let stem = path.file_stem().and_then(OsStr::to_str).unwrap_or_default().to_owned();
                return Ok(vec![ServedFile { name: stem, file: name, bytes: metadata.len() }]);
            }
            Catalog::Directory(directory) => {
                let entries = std::fs::read_dir(directory).map_err(Error::io(directory, "read"))?;
                let served = entries.flatten().filter_map(|entry| {
                    let name = entry.file_name().into_string().ok()?;
                    let path = directory.join(served_name(&name)?);
                    let (_, metadata) = follow(directory, path, &entry.metadata().ok()?)?;
                    Some((name, metadata.len()))
                });
                served.collect()
            }
        };
        let stem = |file: &str| file.rsplit_once('.').map_or(file, |(stem, _)| stem).to_owned();
        let mut stems: BTreeMap<String, usize> = BTreeMap::new();
        files.keys().for_each(|file| *stems.entry(stem(file)).or_default() += 1);
        let listed = files.iter().map(|(file, bytes)| {
            // A stem may be another file's name: `a.goblin.autumn`.
            let stem = stem(file);
            let is_clear = stems[&stem] == 1 && !files.contains_key(&stem) && !has_odd_ending(file);
            ServedFile { name: if is_clear { stem } else { file.clone() }, file: file.clone(), bytes: *bytes }
        });
        Ok(listed.collect())
    }
}

fn missing(name: &str) -> Failure {
    let name: String = name.chars().take(200).collect();
    Failure::missing(format!("`{}`: no served file has this name", name.escape_debug()))
}

/// Returns the name if it is a plain tree file name, without path components that could leave the
/// directory.
fn served_name(name: &str) -> Option<&str> {
    let path = Path::new(name);
    let is_plain = path.components().eq([Component::Normal(OsStr::new(name))])
        && !name.starts_with('.')
        && !name.contains(['/', '\\', '\0']);
    let is_tree = ENDINGS.iter().any(|ending| {
        path.extension().and_then(OsStr::to_str).is_some_and(|own| own.eq_ignore_ascii_case(ending))
    });
    (is_plain && is_tree).then_some(name)
}

/// Whether a file's extension is not in lower case: its stem does not find it.
fn has_odd_ending(name: &str) -> bool {
    !ENDINGS.iter().any(|ending| name.ends_with(ending))
}

/// Resolves a path in a directory to a regular file. Symbolic links must not leave the directory.
fn follow(directory: &Path, path: PathBuf, metadata: &Metadata) -> Option<(PathBuf, Metadata)> {
    if metadata.is_file() {
        return Some((path, metadata.clone()));
    }
    if !metadata.is_symlink() {
        return None;
    }
    let target = path.canonicalize().ok()?;
    let metadata = target.metadata().ok()?;
    (target.starts_with(directory) && metadata.is_file()).then_some((target, metadata))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn served_names_stay_in_their_directory() {
        for name in ["a.goblin", "a b.AUTUMN", "ä.goblin", "a.b.goblin", "a@1.goblin"] {
            assert_eq!(served_name(name), Some(name));
        }
        let wrong = [
            "",
            ".",
            "..",
            "../a.goblin",
            "/a.goblin",
            "a/b.goblin",
            "a\\b.goblin",
            "a\0.goblin",
            ".a.goblin",
            "a.goblin/",
            "./a.goblin",
            "a.goblin/.",
            "a",
            "a.tif",
            "a.goblin.partial",
        ];
        for name in wrong {
            assert_eq!(served_name(name), None, "{name:?}");
        }
    }
}

//! Sources of served indexes: files that have their cells. A page that reads an index by ranges
//! reads its sources, too.

use std::collections::{HashMap, HashSet};
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use spinney_base::io::FileAccess;
use spinney_base::{Error, Result};
use spinney_container::{Content, FileHeader, TreeFormat};
use spinney_engine::dataset;
use spinney_engine::ops::TreeFile;

use crate::catalog::Catalog;
use crate::version::FileVersion;

/// Names of the sources of a version of a file; empty if it is not an index.
type Names = (FileVersion, Arc<HashSet<String>>);

/// Sources of the catalog's indexes, by the paths of these.
pub(crate) struct IndexSources {
    access: FileAccess,
    known: Mutex<HashMap<PathBuf, Names>>,
}

impl IndexSources {
    pub(crate) fn new(access: &FileAccess) -> IndexSources {
        IndexSources { access: access.clone(), known: Mutex::default() }
    }

    /// Returns the path of a source, whose name is relative to the catalog's directory. It must be
    /// in the directory, and an index of the catalog must name it.
    ///
    /// # Errors
    /// If the directory cannot be read.
    pub(crate) fn find(&self, catalog: &Catalog, name: &str) -> Result<Option<PathBuf>> {
        let directory = catalog.directory();
        let Some(path) = confined(directory, name) else { return Ok(None) };
        let files = catalog.list()?;
        let mut paths = files.iter().filter_map(|file| catalog.file(&file.file).ok());
        Ok(paths.any(|index| self.names(&index).is_ok_and(|names| names.contains(name))).then_some(path))
    }

    /// Returns the names of an index's sources.
    fn names(&self, path: &Path) -> Result<Arc<HashSet<String>>> {
        let (version, _) = FileVersion::settled(path, || path.metadata())?;
        let known = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, names)) = known().get(path).filter(|(known, _)| *known == version) {
            return Ok(names.clone());
        }
        let names = match read_names(path, &self.access) {
            Err(error @ Error::Io { .. }) => return Err(error),
            // (A corrupt index is not opened for each request.)
            names => Arc::new(names.unwrap_or_default()),
        };
        let mut known = known();
        // (Files that were replaced or removed.)
        known.retain(|path, (version, _)| FileVersion::at(path).is_ok_and(|found| found == *version));
        known.insert(path.to_path_buf(), (version, names.clone()));
        Ok(names)
    }
}

/// Returns the path of a file in a directory, by its path relative to it.
fn confined(directory: &Path, name: &str) -> Option<PathBuf> {
    let is_visible = |part: &str| !part.is_empty() && !part.starts_with('.');
    let is_plain = name.split('/').all(is_visible)
        && !name.contains(['\\', '\0'])
        && Path::new(name).components().all(|part| matches!(part, Component::Normal(_)));
    if !is_plain {
        return None;
    }
    // (Symbolic links must not leave the directory.)
    let directory = directory.canonicalize().ok()?;
    let path = directory.join(name).canonicalize().ok()?;
    (path.starts_with(&directory) && path.is_file()).then_some(path)
}

/// Reads the names of an index's sources; none if the file is not an index.
fn read_names(path: &Path, access: &FileAccess) -> Result<HashSet<String>> {
    // (A manifest would open its files.)
    let header = FileHeader::find(path, access)?;
    let is_goblin =
        header.is_some_and(|header| (header.format, header.content) == (TreeFormat::Goblin, Content::Cells));
    let opened = if is_goblin { dataset::open(path, &access.into())?.as_file() } else { None };
    let Some(TreeFile::Goblin(file)) = opened else { return Ok(HashSet::new()) };
    let Some((cells, bytes)) = file.references() else { return Ok(HashSet::new()) };
    let mut names = HashSet::new();
    cells.visit_sources(bytes, &mut |name, _| {
        names.insert(name.to_string());
        Ok(true)
    })?;
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_stay_in_the_directory() {
        let directory = tempfile::tempdir().unwrap();
        let [inner, outer] = ["in", "out"].map(|name| directory.path().join(name));
        std::fs::create_dir_all(inner.join("deep")).unwrap();
        std::fs::create_dir_all(&outer).unwrap();
        for path in [inner.join("a.tif"), inner.join("deep/b.tif"), inner.join(".c.tif"), outer.join("d.tif")]
        {
            std::fs::write(path, "").unwrap();
        }
        for name in ["a.tif", "deep/b.tif"] {
            assert_eq!(confined(&inner, name), Some(inner.canonicalize().unwrap().join(name)));
        }
        let absolute = inner.join("a.tif");
        let wrong =
            ["", ".", "deep", "./a.tif", "deep/../a.tif", "../out/d.tif", ".c.tif", "deep//b.tif", "no.tif"];
        for name in wrong.into_iter().chain([absolute.to_str().unwrap()]) {
            assert_eq!(confined(&inner, name), None, "{name}");
        }
    }
}

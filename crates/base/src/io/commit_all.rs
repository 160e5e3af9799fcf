//! Files that are committed together, such as those of a shapefile.

use std::path::{Path, PathBuf};

use super::output::Output;
use crate::url::url_of;
use crate::{Error, Result};

/// Commits several outputs: all of them, or none as far as the file system allows.
///
/// All bytes are on the disk before the first file is renamed, so that a full disk is detected by
/// then. If a commit fails nevertheless, the files committed before it are removed, except those
/// that replaced an older file.
///
/// # Errors
/// Those of [`Output::commit`].
pub fn commit_all(mut outputs: Vec<Output>) -> Result<()> {
    for output in &mut outputs {
        let path = output.path().to_path_buf();
        output.prepare().map_err(Error::io(path, "write"))?;
    }
    let mut placed: Vec<PathBuf> = Vec::new();
    for output in outputs {
        let path = output.path().to_path_buf();
        let is_new = output.is_file() && url_of(&path).is_none() && std::fs::symlink_metadata(&path).is_err();
        if let Err(error) = output.commit() {
            placed.iter().for_each(|path| drop(std::fs::remove_file(path)));
            return Err(error);
        }
        if is_new {
            placed.push(path);
        }
    }
    Ok(())
}

/// New directories for outputs. Dropping this removes those that are empty, unless they were
/// [kept](NewDirectories::keep).
#[derive(Debug, Default)]
pub struct NewDirectories(Vec<PathBuf>);

impl NewDirectories {
    /// Creates a directory and its missing parents.
    ///
    /// # Errors
    /// If that fails.
    pub fn make(&mut self, directory: &Path) -> Result<()> {
        let missing = directory.ancestors().take_while(|path| !path.as_os_str().is_empty() && !path.exists());
        let missing: Vec<PathBuf> = missing.map(Path::to_path_buf).collect();
        std::fs::create_dir_all(directory).map_err(Error::io(directory, "create the directory"))?;
        self.0.extend(missing.into_iter().rev());
        Ok(())
    }

    /// Keeps all directories.
    pub fn keep(mut self) {
        self.0.clear();
    }
}

impl Drop for NewDirectories {
    fn drop(&mut self) {
        for directory in self.0.iter().rev() {
            let _ = std::fs::remove_dir(directory);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{self, Write};
    use std::sync::Arc;

    use super::*;
    use crate::io::Faults;

    /// A disk without space for bytes, or one whose sync fails.
    struct Full {
        writes: bool,
    }

    impl Faults for Full {
        fn write(&self, length: usize) -> io::Result<usize> {
            if self.writes { Ok(length) } else { Err(io::ErrorKind::StorageFull.into()) }
        }

        fn sync(&self) -> io::Result<()> {
            Err(io::ErrorKind::StorageFull.into())
        }
    }

    #[test]
    fn files_are_put_in_place_together_or_not_at_all() {
        for writes in [false, true] {
            let directory = tempfile::tempdir().unwrap();
            let path = |name: &str| directory.path().join(name);
            std::fs::write(path("b"), "old").unwrap();
            let create = |name: &str| {
                let mut output = Output::create(&path(name)).unwrap();
                if name == "c" {
                    output = output.with_faults(Arc::new(Full { writes }));
                }
                output.write_all(b"new").unwrap();
                output
            };
            let error = commit_all(["a", "b", "c"].map(create).into()).unwrap_err();
            assert!(matches!(&error, Error::Io { path: at, .. } if *at == path("c")), "{error}");
            assert!(!path("a").exists() && std::fs::read_dir(directory.path()).unwrap().count() == 1);
            assert_eq!(std::fs::read(path("b")).unwrap(), b"old");
            commit_all(["a", "b"].map(create).into()).unwrap();
            assert_eq!(std::fs::read(path("a")).unwrap(), std::fs::read(path("b")).unwrap());
        }
    }

    #[test]
    fn directories_go_again_unless_they_have_something() {
        let parent = tempfile::tempdir().unwrap();
        let path = |name: &str| parent.path().join(name);
        let mut made = NewDirectories::default();
        made.make(&path("a/b/c")).unwrap();
        made.make(&path("a/d")).unwrap();
        std::fs::write(path("a/d/x"), "1").unwrap();
        drop(made);
        assert!(!path("a/b").exists() && path("a/d/x").exists());
        let mut made = NewDirectories::default();
        made.make(&path("a/b")).unwrap();
        made.keep();
        assert!(path("a/b").exists());
    }
}

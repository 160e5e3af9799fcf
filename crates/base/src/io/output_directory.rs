//! Output directories that appear whole or not at all.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::output::{directory_of, sync_directory};
use crate::{Error, Result};

/// Destination of many files: a new directory that appears whole or not at all.
///
/// Files are written to a temporary directory next to the target, which [`OutputDirectory::commit`]
/// renames. Dropping it without a commit removes everything.
pub struct OutputDirectory {
    path: PathBuf,
    work: tempfile::TempDir,
}

impl OutputDirectory {
    /// Starts a directory.
    ///
    /// # Errors
    /// If the path exists and is not an empty directory, or no directory can be created next to it.
    pub fn create(path: &Path) -> Result<OutputDirectory> {
        check_free(path)?;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let work = tempfile::Builder::new()
            .prefix(&format!(".{name}."))
            .suffix(".partial")
            .tempdir_in(directory_of(path));
        let work = work.map_err(Error::io(path, "create a temporary directory next to it"))?;
        Ok(OutputDirectory { path: path.to_path_buf(), work })
    }

    /// Returns the final path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes a file. Its name has `/` between directories, which are created. Several threads may
    /// call this at a time.
    ///
    /// # Errors
    /// If that fails.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        let path = self.work.path().join(name);
        let write = || match fs::write(&path, bytes) {
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => {
                fs::create_dir_all(directory_of(&path))?;
                fs::write(&path, bytes)
            }
            done => done,
        };
        write().map_err(Error::io(self.path.join(name), "write"))
    }

    /// Puts the directory in place.
    ///
    /// # Errors
    /// If that fails, or the path exists by now and is not an empty directory. All files are then
    /// removed.
    pub fn commit(self) -> Result<()> {
        check_free(&self.path)?;
        let put = || {
            set_usual_permissions(self.work.path())?;
            if self.path.exists() {
                fs::remove_dir(&self.path)?;
            }
            fs::rename(self.work.path(), &self.path)
        };
        put().map_err(Error::io(&self.path, "rename the temporary directory to it"))?;
        // After the rename there is nothing left to remove.
        let _ = self.work.keep();
        sync_directory(directory_of(&self.path)).map_err(Error::io(&self.path, "sync its parent directory"))
    }
}

/// Fails if the path exists and is not an empty directory.
fn check_free(path: &Path) -> Result<()> {
    let is_free = match fs::read_dir(path) {
        Ok(mut entries) => entries.next().is_none(),
        Err(cause) => cause.kind() == io::ErrorKind::NotFound,
    };
    if is_free {
        return Ok(());
    }
    let advice = "nothing was written; choose another name, or remove it first";
    Err(Error::unsupported(path, "replacing a file or a directory that is not empty", advice))
}

/// Gives a temporary directory the permissions of ordinary ones.
fn set_usual_permissions(path: &Path) -> io::Result<()> {
    // A directory that is created in the usual way has these permissions.
    let like = path.join(".permissions");
    fs::create_dir(&like)?;
    let permissions = fs::metadata(&like)?.permissions();
    fs::remove_dir(&like)?;
    fs::set_permissions(path, permissions)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn appears_whole_or_not_at_all() {
        let parent = tempfile::tempdir().unwrap();
        let path = parent.path().join("out");
        let started = OutputDirectory::create(&path).unwrap();
        started.write("a/b/c.txt", b"1").unwrap();
        assert!(!path.exists());
        drop(started);
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 0);
        let started = OutputDirectory::create(&path).unwrap();
        started.write("a/b/c.txt", b"1").unwrap();
        started.commit().unwrap();
        assert_eq!(fs::read(path.join("a/b/c.txt")).unwrap(), b"1");
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 1);
        assert!(OutputDirectory::create(&path).is_err(), "it is not empty");
    }
}

//! Locks on directories: a separate file in or next to the directory, which one process holds at a
//! time.

use std::fs::{File, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use super::file_id::FileId;
use super::output::Unfinished;
use super::regular::open_regular;
use crate::{Error, Result};

/// Maximum number of bytes that are read of the holder's note.
const NOTE: u64 = 256;

/// A file that only this process holds. It is removed when this is dropped.
pub struct LockFile {
    path: PathBuf,
    file: File,
    _unfinished: Unfinished,
}

impl LockFile {
    /// Creates the file, or reuses the one of a killed process, and writes a note of the holder
    /// into it. `locked` is the locked path, for messages.
    ///
    /// # Errors
    /// [`Error::Locked`] if another process holds the file. Also if it cannot be created, or its
    /// path is not a regular file.
    pub fn take(path: &Path, locked: &Path) -> Result<LockFile> {
        loop {
            let mut options = File::options();
            let file = open_regular(options.read(true).write(true).create(true).truncate(false), path)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    return Err(Error::Locked { holder: holder(path), path: locked.to_path_buf() });
                }
                Err(TryLockError::Error(cause)) => return Err(Error::io(path, "lock")(cause)),
            }
            // The previous holder may have removed the file after it was opened here. Such a lock
            // protects nothing.
            let own = FileId::of(&file).map_err(Error::io(path, "stat"))?;
            if !FileId::at(path).is_ok_and(|there| there == own || there.is_unique()) {
                continue;
            }
            let lock = LockFile { path: path.to_path_buf(), _unfinished: Unfinished::new(path), file };
            let program = std::env::args().next().unwrap_or_default();
            let program = Path::new(&program).file_name().unwrap_or_default().to_string_lossy();
            let note = format!("process {} ({program})", std::process::id());
            let written = lock.file.set_len(0).and_then(|()| (&lock.file).write_all(note.as_bytes()));
            written.map_err(Error::io(path, "write the name of the lock holder"))?;
            return Ok(lock);
        }
    }

    /// Describes the process that holds the lock at this path; `None` if there is none.
    pub fn holder(path: &Path) -> Option<String> {
        let file = open_regular(File::options().read(true), path).ok()?;
        matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)).then(|| holder(path))
    }
}

impl Drop for LockFile {
    /// Removes the file before the lock is released, so that no process locks a file that is about
    /// to be removed.
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
        let _ = self.file.unlock();
    }
}

/// Returns the holder of the lock, as far as the file records it.
fn holder(path: &Path) -> String {
    let mut bytes = Vec::new();
    let _ = File::open(path).and_then(|file| file.take(NOTE).read_to_end(&mut bytes));
    let text: String = String::from_utf8_lossy(&bytes).chars().take_while(|c| !c.is_control()).collect();
    if text.is_empty() { "another process".into() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_has_it_at_a_time_and_nothing_is_left() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join(".lock");
        assert_eq!(LockFile::holder(&path), None);
        let lock = LockFile::take(&path, directory.path()).unwrap();
        let own = format!("process {}", std::process::id());
        assert!(LockFile::holder(&path).is_some_and(|holder| holder.starts_with(&own)));
        match LockFile::take(&path, directory.path()) {
            Err(Error::Locked { path, holder }) => {
                assert!(path == directory.path() && holder.starts_with(&own));
            }
            other => panic!("{:?}", other.err()),
        }
        drop(lock);
        assert!(!path.exists());
        // The file of a killed process is reused.
        std::fs::write(&path, "process 1 (killed)").unwrap();
        assert_eq!(LockFile::holder(&path), None);
        drop(LockFile::take(&path, directory.path()).unwrap());
        assert!(!path.exists());
    }

    #[test]
    #[cfg(unix)]
    fn links_are_not_followed() {
        let directory = tempfile::tempdir().unwrap();
        let (path, other) = (directory.path().join(".lock"), directory.path().join("other"));
        std::fs::write(&other, "precious").unwrap();
        std::os::unix::fs::symlink(&other, &path).unwrap();
        assert!(matches!(LockFile::take(&path, directory.path()), Err(Error::Unsupported { .. })));
        assert_eq!(std::fs::read(&other).unwrap(), b"precious");
    }
}

//! Locks on folders: a file of its own in or beside the folder, which one process has at a time.

use std::fs::{File, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use super::file_id::FileId;
use super::output::Unfinished;
use super::regular::open_regular;
use crate::{Error, Result};

/// Bytes of the note of who has the lock that are read at most.
const NOTE: u64 = 256;

/// File that only this process has, until this is dropped, which removes it.
pub struct LockFile {
    path: PathBuf,
    file: File,
    _unfinished: Unfinished,
}

impl LockFile {
    /// Makes the file, or takes over one that a process that was killed has left, and says in it who has it. `locked` is what it
    /// is the lock of, for messages.
    ///
    /// # Errors
    /// [`Error::Locked`] if another process has it; if it cannot be made, or something that is no file has its name.
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
            // Whoever had it may have removed the file after it was opened here: such a lock is nobody's.
            let own = FileId::of(&file).map_err(Error::io(path, "look at"))?;
            if !FileId::at(path).is_ok_and(|there| there == own || there.is_unique()) {
                continue;
            }
            let lock = LockFile { path: path.to_path_buf(), _unfinished: Unfinished::new(path), file };
            let program = std::env::args().next().unwrap_or_default();
            let program = Path::new(&program).file_name().unwrap_or_default().to_string_lossy();
            let note = format!("process {} ({program})", std::process::id());
            let written = lock.file.set_len(0).and_then(|()| (&lock.file).write_all(note.as_bytes()));
            written.map_err(Error::io(path, "write the lock's note"))?;
            return Ok(lock);
        }
    }

    /// The process that has the lock of this name, in words; `None` if none has.
    pub fn holder(path: &Path) -> Option<String> {
        let file = open_regular(File::options().read(true), path).ok()?;
        matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)).then(|| holder(path))
    }
}

impl Drop for LockFile {
    /// The file goes before the lock, so that nobody takes a lock on a file that goes.
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
        let _ = self.file.unlock();
    }
}

/// Who has the lock, as far as the file says.
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
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(".lock");
        assert_eq!(LockFile::holder(&path), None);
        let lock = LockFile::take(&path, folder.path()).unwrap();
        let own = format!("process {}", std::process::id());
        assert!(LockFile::holder(&path).is_some_and(|holder| holder.starts_with(&own)));
        match LockFile::take(&path, folder.path()) {
            Err(Error::Locked { path, holder }) => {
                assert!(path == folder.path() && holder.starts_with(&own));
            }
            other => panic!("{:?}", other.err()),
        }
        drop(lock);
        assert!(!path.exists());
        // One that was left behind is taken over.
        std::fs::write(&path, "process 1 (killed)").unwrap();
        assert_eq!(LockFile::holder(&path), None);
        drop(LockFile::take(&path, folder.path()).unwrap());
        assert!(!path.exists());
    }

    #[test]
    #[cfg(unix)]
    fn links_are_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (path, other) = (folder.path().join(".lock"), folder.path().join("other"));
        std::fs::write(&other, "precious").unwrap();
        std::os::unix::fs::symlink(&other, &path).unwrap();
        assert!(matches!(LockFile::take(&path, folder.path()), Err(Error::Unsupported { .. })));
        assert_eq!(std::fs::read(&other).unwrap(), b"precious");
    }
}

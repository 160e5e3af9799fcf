//! Locks for a single writer: a lock on the file itself, and a note in the file that identifies the
//! holder.

use std::fs::{File, TryLockError};
use std::io::{self, Read};
use std::path::Path;

use super::access::FileAccess;
use super::file_id::FileId;
use super::platform::path_of;
use super::read::ReadBackend;
use super::write::{FileBackend, WriteBackend};
use crate::{Error, Result};

/// Offset of the note that identifies the writer: in the header's page, after all other bytes. It
/// is not part of the stored data.
const NOTE_OFFSET: u64 = 2048;
/// Size of the note in bytes; unused bytes are zero.
const NOTE_SIZE: usize = 256;

/// A file that only this process may write, until this is dropped.
pub struct LockedFile(FileBackend);

impl LockedFile {
    /// Locks a file, and writes a note of the holder into it.
    ///
    /// # Errors
    /// If another process has the lock, or the note cannot be written.
    pub fn new(file: FileBackend) -> Result<LockedFile> {
        match file.file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(Error::Locked { holder: holder(&file.path), path: file.path });
            }
            Err(TryLockError::Error(cause)) => return Err(Error::io(file.path, "lock")(cause)),
        }
        // From here on, dropping `locked` releases the lock on all paths.
        let mut locked = LockedFile(file);
        let program = std::env::args().next().unwrap_or_default();
        let program = Path::new(&program).file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut note = format!("process {} ({program})", std::process::id()).into_bytes();
        note.resize(NOTE_SIZE, 0);
        let written = locked.write(NOTE_OFFSET, &note);
        written.map_err(Error::io(&*locked.0.path, "write the name of the lock holder"))?;
        Ok(locked)
    }
}

impl Drop for LockedFile {
    /// Releases the lock.
    ///
    /// Closing the file is not enough: the lock lasts as long as any copy of the descriptor is
    /// open. A process that is being spawned has one until it runs its program, and so has every
    /// mapping that readers still hold.
    fn drop(&mut self) {
        // If this fails, the lock ends with the last copy of the descriptor.
        let _ = self.0.file.unlock();
    }
}

/// Lock of a file that is read and then replaced by another one, until this is dropped. Only
/// processes that replace the file take this lock.
pub struct ReplaceLock(File);

impl ReplaceLock {
    /// Locks the file that is at a path now.
    ///
    /// # Errors
    /// If another process has the lock, or the file cannot be opened.
    pub fn take(path: &Path) -> Result<ReplaceLock> {
        loop {
            let file = File::open(path).map_err(Error::io(path, "open"))?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    return Err(Error::Locked { path: path.into(), holder: "another process".into() });
                }
                Err(TryLockError::Error(cause)) => return Err(Error::io(path, "lock")(cause)),
            }
            let lock = ReplaceLock(file);
            // The previous holder may have replaced the file after it was opened here.
            let own = FileId::of(&lock.0).map_err(Error::io(path, "stat"))?;
            if FileId::at(path).is_ok_and(|there| there == own || there.is_unique()) {
                return Ok(lock);
            }
        }
    }
}

impl Drop for ReplaceLock {
    /// Releases the lock at once, as [`LockedFile`] does.
    fn drop(&mut self) {
        let _ = self.0.unlock();
    }
}

impl WriteBackend for LockedFile {
    fn write(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        self.0.write(offset, bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.0.sync()
    }

    fn reader(&self) -> Result<Box<dyn ReadBackend>> {
        self.0.reader()
    }

    fn access(&self) -> FileAccess {
        self.0.access()
    }

    fn id(&self) -> FileId {
        self.0.id()
    }

    fn check_path(&self) -> Result<()> {
        let FileBackend { file, path, .. } = &self.0;
        let what = match FileId::at(path) {
            Ok(there) if there == self.id() || there.is_unique() => return Ok(()),
            Ok(_) => "was replaced by another file",
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => "was moved or removed",
            Err(cause) => return Err(Error::io(path, "stat")(cause)),
        };
        Err(Error::Moved { path: path.clone(), what, file: path_of(file) })
    }
}

/// Returns the holder of the lock, as far as the file records it.
fn holder(path: &Path) -> String {
    let mut bytes = Vec::new();
    let read =
        File::open(path).and_then(|file| file.take(NOTE_OFFSET + NOTE_SIZE as u64).read_to_end(&mut bytes));
    let note = bytes.get(NOTE_OFFSET as usize..).filter(|_| read.is_ok()).unwrap_or_default();
    let text: String = String::from_utf8_lossy(note).chars().take_while(|c| !c.is_control()).collect();
    if text.is_empty() { "another process".into() } else { text }
}

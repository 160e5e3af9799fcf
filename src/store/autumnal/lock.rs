//! One writer at a time.

use std::fs::{File, TryLockError};
use std::io::Read;
use std::path::Path;

use super::medium::{FileMedium, Medium};
use crate::{Error, Result};

/// Where the writer says who it is: in the header's page, behind everything else. It is no part of what is stored.
const PLACE: u64 = 2048;
const LENGTH: usize = 256;

/// Takes the file for this process, until it is closed, and says so in it.
pub(super) fn lock(medium: &mut FileMedium) -> Result<()> {
    match medium.file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            return Err(Error::Locked { path: medium.path.clone(), holder: holder(&medium.path) });
        }
        Err(TryLockError::Error(cause)) => return Err(Error::io(&*medium.path, "lock")(cause)),
    }
    let program = std::env::args().next().unwrap_or_default();
    let program = Path::new(&program).file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut note = format!("process {} ({program})", std::process::id()).into_bytes();
    note.truncate(LENGTH);
    note.resize(LENGTH, 0);
    medium.write(PLACE, &note).map_err(Error::io(&*medium.path, "write the lock's note"))
}

/// Who has locked the file, as far as it says.
fn holder(path: &Path) -> String {
    let mut bytes = Vec::new();
    let read = File::open(path).and_then(|file| file.take(PLACE + LENGTH as u64).read_to_end(&mut bytes));
    let note = bytes.get(PLACE as usize..).filter(|_| read.is_ok()).unwrap_or_default();
    let text: String = String::from_utf8_lossy(note).chars().take_while(|c| !c.is_control()).collect();
    if text.is_empty() { "another process".into() } else { text }
}

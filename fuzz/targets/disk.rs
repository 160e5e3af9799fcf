//! A disk in memory that records requests, and may fail.

use std::io;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard};

use spinney::edit::Editor;
use spinney::raw::io::{FileId, ReadBackend, WriteBackend};

/// A request to a disk.
#[derive(Clone)]
pub enum Event {
    /// Offset and bytes.
    Write(u64, Vec<u8>),
    Sync,
}

/// A shared disk.
#[derive(Clone)]
pub struct Disk(Arc<Mutex<State>>);

/// The bytes of a disk, and the number of writes that succeed.
pub struct State {
    pub bytes: Vec<u8>,
    pub events: Vec<Event>,
    /// Writes and syncs that will still succeed.
    pub good: usize,
    id: FileId,
}

impl Disk {
    /// Creates a disk with some bytes, which does not fail.
    pub fn new(bytes: Vec<u8>) -> Disk {
        let state = State { bytes, events: Vec::new(), good: usize::MAX, id: FileId::unique() };
        Disk(Arc::new(Mutex::new(state)))
    }

    pub fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap()
    }

    /// Returns an editor of the file on the disk.
    pub fn editor(&self) -> spinney::Result<Editor> {
        Editor::on(Box::new(self.clone()), Path::new("(disk)"), 1 << 20)
    }
}

impl State {
    fn use_quota(&mut self) -> io::Result<()> {
        match self.good.checked_sub(1) {
            Some(good) => self.good = good,
            None => return Err(io::Error::other("the disk has failed")),
        }
        Ok(())
    }
}

/// Writes bytes at an offset, which may be after the end.
pub fn put(bytes: &mut Vec<u8>, offset: u64, new: &[u8]) {
    let end = offset as usize + new.len();
    if bytes.len() < end {
        bytes.resize(end, 0);
    }
    bytes[offset as usize..end].copy_from_slice(new);
}

impl WriteBackend for Disk {
    fn write(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        let mut state = self.state();
        if let Err(error) = state.use_quota() {
            // Half of it arrives.
            let half = &bytes[..bytes.len() / 2];
            put(&mut state.bytes, offset, half);
            return Err(error);
        }
        put(&mut state.bytes, offset, bytes);
        state.events.push(Event::Write(offset, bytes.to_vec()));
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        let mut state = self.state();
        state.use_quota()?;
        state.events.push(Event::Sync);
        Ok(())
    }

    fn reader(&self) -> spinney::Result<Box<dyn ReadBackend>> {
        Ok(Box::new(self.state().bytes.clone()))
    }

    fn id(&self) -> FileId {
        self.state().id
    }
}

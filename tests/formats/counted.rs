//! Byte storage in memory that counts reads and writes, for tests of costs.

use std::borrow::Cow;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use spinney::Result;
use spinney::edit::Editor;
use spinney::raw::io::{FileId, ReadBackend, WriteBackend};

/// Reads and writes of some bytes.
#[derive(Default)]
pub(super) struct Work {
    reads: AtomicU64,
    written: AtomicU64,
}

impl Work {
    /// Number of reads.
    pub(super) fn reads(&self) -> u64 {
        self.reads.load(Ordering::Relaxed)
    }

    /// Bytes that were written.
    pub(super) fn written(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }

    /// Returns a query's result and the number of its reads.
    pub(super) fn of<T>(&self, query: impl FnOnce() -> T) -> (T, u64) {
        let before = self.reads();
        let result = query();
        (result, self.reads() - before)
    }
}

/// A file in memory whose accesses are counted.
struct Counted {
    bytes: Arc<Mutex<Vec<u8>>>,
    work: Arc<Work>,
    id: FileId,
}

/// A file's contents up to its end at some time. Only the meta slots are overwritten.
struct Snapshot {
    bytes: Arc<Mutex<Vec<u8>>>,
    len: u64,
    work: Arc<Work>,
}

impl ReadBackend for Snapshot {
    fn len(&self) -> u64 {
        self.len
    }

    fn bytes(&self) -> Option<&[u8]> {
        None
    }

    fn read(&self, offset: u64, length: usize) -> Result<Cow<'_, [u8]>> {
        self.work.reads.fetch_add(1, Ordering::Relaxed);
        Ok(Cow::Owned(self.bytes.lock().unwrap()[offset as usize..][..length].to_vec()))
    }
}

impl WriteBackend for Counted {
    fn write(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        self.work.written.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        let mut file = self.bytes.lock().unwrap();
        let end = offset as usize + bytes.len();
        let length = file.len().max(end);
        file.resize(length, 0);
        file[offset as usize..end].copy_from_slice(bytes);
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }

    fn reader(&self) -> Result<Box<dyn ReadBackend>> {
        let len = self.bytes.lock().unwrap().len() as u64;
        Ok(Box::new(Snapshot { bytes: self.bytes.clone(), len, work: self.work.clone() }))
    }

    fn id(&self) -> FileId {
        self.id
    }
}

/// An Autumnal file in memory, open for reading and editing, with counted accesses.
pub(super) struct CountedFile {
    pub(super) editor: Editor,
    pub(super) work: Arc<Work>,
    bytes: Arc<Mutex<Vec<u8>>>,
}

impl CountedFile {
    /// Opens the bytes of a file.
    pub(super) fn new(bytes: Vec<u8>) -> CountedFile {
        let (work, bytes) = (Arc::<Work>::default(), Arc::new(Mutex::new(bytes)));
        let editor = editor(&bytes, &work);
        CountedFile { editor, work, bytes }
    }

    /// Opens the file again.
    pub(super) fn reopen(&mut self) {
        self.editor = editor(&self.bytes, &self.work);
    }

    /// All bytes.
    pub(super) fn bytes(&self) -> Vec<u8> {
        self.bytes.lock().unwrap().clone()
    }
}

fn editor(bytes: &Arc<Mutex<Vec<u8>>>, work: &Arc<Work>) -> Editor {
    let backend = Counted { bytes: bytes.clone(), work: work.clone(), id: FileId::unique() };
    Editor::on(Box::new(backend), Path::new("(counted)"), 1 << 24).unwrap()
}

//! Bytes in memory that count how often, and how much of them, is read and written: for tests of costs.

use std::borrow::Cow;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use spinney::Result;
use spinney::io::{FileId, ReadBackend, WriteBackend};
use spinney::store::autumnal::Editor;

/// Work that was done with some bytes.
#[derive(Default)]
pub(super) struct Work {
    reads: AtomicU64,
    read: AtomicU64,
    written: AtomicU64,
}

impl Work {
    /// Number of reads.
    pub(super) fn reads(&self) -> u64 {
        self.reads.load(Ordering::Relaxed)
    }

    /// Bytes that were read.
    pub(super) fn read(&self) -> u64 {
        self.read.load(Ordering::Relaxed)
    }

    /// Bytes that were written.
    pub(super) fn written(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }

    /// The answer to a question, and the reads that it took.
    pub(super) fn of<T>(&self, ask: impl FnOnce() -> T) -> (T, u64) {
        let before = self.reads();
        let answer = ask();
        (answer, self.reads() - before)
    }
}

/// A file in memory whose uses are counted.
struct Counted {
    bytes: Arc<Mutex<Arc<Vec<u8>>>>,
    work: Arc<Work>,
    id: FileId,
}

/// What is in it at some time.
struct Snapshot {
    bytes: Arc<Vec<u8>>,
    work: Arc<Work>,
}

impl ReadBackend for Snapshot {
    fn len(&self) -> u64 {
        self.bytes.len() as u64
    }

    fn bytes(&self) -> Option<&[u8]> {
        None
    }

    fn read(&self, offset: u64, length: usize) -> Result<Cow<'_, [u8]>> {
        self.work.reads.fetch_add(1, Ordering::Relaxed);
        self.work.read.fetch_add(length as u64, Ordering::Relaxed);
        Ok(Cow::Borrowed(&self.bytes[offset as usize..][..length]))
    }
}

impl WriteBackend for Counted {
    fn write(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        self.work.written.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        let mut file = self.bytes.lock().unwrap();
        let file = Arc::make_mut(&mut file);
        let end = offset as usize + bytes.len();
        file.resize(file.len().max(end), 0);
        file[offset as usize..end].copy_from_slice(bytes);
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }

    fn reader(&self) -> Result<Box<dyn ReadBackend>> {
        Ok(Box::new(Snapshot { bytes: self.bytes.lock().unwrap().clone(), work: self.work.clone() }))
    }

    fn id(&self) -> FileId {
        self.id
    }
}

/// Opens the bytes of an Autumnal file to be read and edited, all by positioned reads, and counts them.
pub(super) fn editor(bytes: Vec<u8>) -> (Editor, Arc<Work>) {
    let work = Arc::<Work>::default();
    let bytes = Arc::new(Mutex::new(Arc::new(bytes)));
    let backend = Counted { bytes, work: work.clone(), id: FileId::unique() };
    (Editor::on(Box::new(backend), Path::new("(counted)"), 1 << 24).unwrap(), work)
}

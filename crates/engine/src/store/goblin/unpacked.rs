//! Packed segments as plain ones, in a cache that all open files of the process share.

use std::cell::RefCell;
use std::sync::{Arc, Weak};

use spinney_base::io::{HeldBytes, RangeCache};

/// The segments of an open layer that were unpacked lately.
pub(super) struct Unpacked {
    /// Number of the layer in the cache.
    number: u64,
}

/// Ways past the cache that a thread knows.
const WAYS: usize = 16;

/// A segment that a thread has used lately: whoever goes through one node by node need not ask the cache, which all threads share, for
/// each of them. It does not keep the bytes: what the cache has let go of and nobody uses is gone.
struct Way {
    number: u64,
    index: usize,
    bytes: Weak<Vec<u8>>,
}

thread_local! {
    static RECENT: RefCell<[Way; WAYS]> =
        const { RefCell::new([const { Way { number: u64::MAX, index: 0, bytes: Weak::new() } }; WAYS]) };
}

/// The place of a segment in the cache. (Places are as far apart as the bytes of one can be long.)
fn place(index: usize) -> u64 {
    (index as u64) << 32
}

impl Unpacked {
    pub(super) fn new() -> Unpacked {
        Unpacked { number: RangeCache::file_number() }
    }

    /// The bytes of a segment, of which there are so many, if they are held.
    pub(super) fn get(&self, index: usize, length: usize) -> Option<HeldBytes> {
        let way = RECENT.with_borrow(|recent| {
            let way = &recent[index % WAYS];
            if (way.number, way.index) == (self.number, index) { way.bytes.upgrade() } else { None }
        });
        if let Some(bytes) = way.filter(|bytes| bytes.len() == length) {
            return Some(bytes.into());
        }
        let first = place(index);
        let held = RangeCache::unpacked().get(self.number, &(first..first + length as u64))?;
        self.remember(index, held.whole());
        Some(held)
    }

    /// Holds the bytes of a segment.
    pub(super) fn put(&self, index: usize, bytes: Arc<Vec<u8>>) -> HeldBytes {
        self.remember(index, &bytes);
        RangeCache::unpacked().put(self.number, place(index), bytes.clone());
        bytes.into()
    }

    fn remember(&self, index: usize, bytes: &Arc<Vec<u8>>) {
        let way = Way { number: self.number, index, bytes: Arc::downgrade(bytes) };
        RECENT.with_borrow_mut(|recent| recent[index % WAYS] = way);
    }
}

impl Drop for Unpacked {
    fn drop(&mut self) {
        RangeCache::unpacked().forget(self.number);
    }
}

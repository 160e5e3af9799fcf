//! Unpacked bytes of packed segments, in the cache of the access that opened the file.

use std::cell::RefCell;
use std::sync::{Arc, Weak};

use super::{CachedBytes, FileAccess, RangeCache};

/// Recently unpacked segments of an open file, by their numbers.
pub struct Unpacked {
    /// Number of the file, or of one of its layers, in the cache.
    number: u64,
    /// Segments are `2^bits` apart in the cache's address space, and shorter than that.
    bits: u32,
    cache: Arc<RangeCache>,
}

/// Number of recently used segments that a thread remembers: 8 KiB of its memory.
const WAYS: usize = 256;

/// A segment that a thread has used recently. It spares a node-by-node traversal the look-up in the
/// cache, which all threads share.
///
/// The reference is weak, so bytes that are evicted from the cache and not in use are freed.
struct Way {
    number: u64,
    index: u64,
    bytes: Weak<Vec<u8>>,
}

thread_local! {
    static RECENT: RefCell<[Way; WAYS]> =
        const { RefCell::new([const { Way { number: u64::MAX, index: 0, bytes: Weak::new() } }; WAYS]) };
}

impl Unpacked {
    /// Creates an empty set of segments in the cache of an access. Each segment has fewer than
    /// `2^bits` bytes unpacked, and a number below `2^(64 - bits)`.
    pub fn new(access: &FileAccess, bits: u32) -> Unpacked {
        Unpacked { number: RangeCache::file_number(), bits, cache: access.unpacked().clone() }
    }

    /// Returns the bytes of a segment, if they are cached.
    pub fn get(&self, index: u64) -> Option<CachedBytes> {
        let way = RECENT.with_borrow(|recent| {
            let way = &recent[self.way(index)];
            if (way.number, way.index) == (self.number, index) { way.bytes.upgrade() } else { None }
        });
        if let Some(bytes) = way {
            return Some(bytes.into());
        }
        // An empty range finds the cached segment, whose handle has all bytes.
        let first = index << self.bits;
        let held = self.cache.get(self.number, &(first..first))?;
        self.remember(index, held.whole());
        Some(held.whole().clone().into())
    }

    /// Caches the bytes of a segment.
    pub fn put(&self, index: u64, bytes: Arc<Vec<u8>>) -> CachedBytes {
        self.remember(index, &bytes);
        self.cache.put(self.number, index << self.bits, bytes.clone());
        bytes.into()
    }

    fn remember(&self, index: u64, bytes: &Arc<Vec<u8>>) {
        let way = Way { number: self.number, index, bytes: Arc::downgrade(bytes) };
        RECENT.with_borrow_mut(|recent| recent[self.way(index)] = way);
    }

    /// Returns the index of a segment in the thread's table. Segments of the same number in several
    /// files or layers are often used together, so it depends on both numbers.
    fn way(&self, index: u64) -> usize {
        (self.number.wrapping_add(index) % WAYS as u64) as usize
    }
}

impl Drop for Unpacked {
    fn drop(&mut self) {
        self.cache.forget(self.number);
    }
}

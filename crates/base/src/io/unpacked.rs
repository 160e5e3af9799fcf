//! Unpacked bytes of packed segments, in the cache of the access that opened the file.

use std::cell::RefCell;
use std::sync::{Arc, Weak};

use super::{CachedBytes, FileAccess, RangeCache};

/// The pieces of an open file that were unpacked lately, by their numbers.
pub struct Unpacked {
    /// Number of the file, or of a layer of it, in the cache.
    number: u64,
    /// Bits of the bytes of a piece: places in the cache are as far apart as it can be long.
    bits: u32,
    cache: Arc<RangeCache>,
}

/// Ways past the cache that a thread knows: 8 KiB of its memory.
const WAYS: usize = 256;

/// A piece that a thread has used lately: whoever goes through one node by node need not ask the cache, which all threads share, for
/// each of them. It does not keep the bytes: what the cache has let go of and nobody uses is gone.
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
    /// No pieces yet, which are held by the cache of an access. Each has fewer than two to the power of `bits` bytes unpacked, and a number of no more than the other bits of 64.
    pub fn new(access: &FileAccess, bits: u32) -> Unpacked {
        Unpacked { number: RangeCache::file_number(), bits, cache: access.unpacked().clone() }
    }

    /// The bytes of a piece, if they are held.
    pub fn get(&self, index: u64) -> Option<CachedBytes> {
        let way = RECENT.with_borrow(|recent| {
            let way = &recent[self.way(index)];
            if (way.number, way.index) == (self.number, index) { way.bytes.upgrade() } else { None }
        });
        if let Some(bytes) = way {
            return Some(bytes.into());
        }
        // (Nothing of it, which leads to all of it.)
        let first = index << self.bits;
        let held = self.cache.get(self.number, &(first..first))?;
        self.remember(index, held.whole());
        Some(held.whole().clone().into())
    }

    /// Holds the bytes of a piece.
    pub fn put(&self, index: u64, bytes: Arc<Vec<u8>>) -> CachedBytes {
        self.remember(index, &bytes);
        self.cache.put(self.number, index << self.bits, bytes.clone());
        bytes.into()
    }

    fn remember(&self, index: u64, bytes: &Arc<Vec<u8>>) {
        let way = Way { number: self.number, index, bytes: Arc::downgrade(bytes) };
        RECENT.with_borrow_mut(|recent| recent[self.way(index)] = way);
    }

    /// The way that a piece has. (Pieces of one number in several lists are often used together.)
    fn way(&self, index: u64) -> usize {
        (self.number.wrapping_add(index) % WAYS as u64) as usize
    }
}

impl Drop for Unpacked {
    fn drop(&mut self) {
        self.cache.forget(self.number);
    }
}

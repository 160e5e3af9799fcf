//! Packed bytes as plain ones, in a cache that all open files of the process share.

use std::cell::RefCell;
use std::sync::{Arc, Weak};

use spinney_base::io::{HeldBytes, RangeCache};

/// The pieces of an open file that were unpacked lately, by their numbers.
pub(super) struct Unpacked {
    /// Number of the file, or of a layer of it, in the cache.
    number: u64,
    /// Bits of the bytes of a piece: places in the cache are as far apart as it can be long.
    bits: u32,
}

/// Bits of the bytes that packed bytes become at most.
pub(super) const PLAIN_BITS: u32 = 27;
/// Bytes that they become at most, however many it has.
const MOST_PLAIN: u64 = 1 << (PLAIN_BITS - 1);
/// Bytes that they become at most: so many, and for each of them so many more.
const PLAIN_FREE: u64 = 64 << 10;
pub(super) const PLAIN_PER_BYTE: u64 = 4096;

/// Whether so many packed bytes may become so many plain ones: else a small file could ask for a lot of memory, and
/// time. What would become more is written plain.
pub(super) fn may_unpack(packed: u64, plain: u64) -> bool {
    plain <= MOST_PLAIN && plain <= PLAIN_FREE.saturating_add(packed.saturating_mul(PLAIN_PER_BYTE))
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
    /// None yet, of pieces that become fewer than two to the power of `bits` bytes; their numbers have no more than the other bits of 64.
    pub(super) fn new(bits: u32) -> Unpacked {
        Unpacked { number: RangeCache::file_number(), bits }
    }

    /// The bytes of a piece, of which there are so many, if they are held.
    pub(super) fn get(&self, index: u64, length: usize) -> Option<HeldBytes> {
        let way = RECENT.with_borrow(|recent| {
            let way = &recent[index as usize % WAYS];
            if (way.number, way.index) == (self.number, index) { way.bytes.upgrade() } else { None }
        });
        if let Some(bytes) = way.filter(|bytes| bytes.len() == length) {
            return Some(bytes.into());
        }
        let first = index << self.bits;
        let held = RangeCache::unpacked().get(self.number, &(first..first + length as u64))?;
        self.remember(index, held.whole());
        Some(held)
    }

    /// Holds the bytes of a piece.
    pub(super) fn put(&self, index: u64, bytes: Arc<Vec<u8>>) -> HeldBytes {
        self.remember(index, &bytes);
        RangeCache::unpacked().put(self.number, index << self.bits, bytes.clone());
        bytes.into()
    }

    fn remember(&self, index: u64, bytes: &Arc<Vec<u8>>) {
        let way = Way { number: self.number, index, bytes: Arc::downgrade(bytes) };
        RECENT.with_borrow_mut(|recent| recent[index as usize % WAYS] = way);
    }
}

impl Drop for Unpacked {
    fn drop(&mut self) {
        RangeCache::unpacked().forget(self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_bytes_become_no_more_than_they_may() {
        for (packed, plain, may) in [
            (0, 65_536, true),
            (0, 65_537, false),
            (1, 69_632, true),
            (1, 69_633, false),
            (1 << 40, 64 << 20, true),
            (1 << 40, (64 << 20) + 1, false),
            (u64::MAX, u64::MAX, false),
        ] {
            assert_eq!(may_unpack(packed, plain), may, "{packed} {plain}");
        }
    }
}

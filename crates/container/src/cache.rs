//! Segments that were read lately, where a file is not mapped.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// Bytes of segments, up to a limit; those not used for longest give way.
pub struct SegmentCache {
    /// Bytes that may be held.
    limit: u64,
    /// Bytes that are held.
    held: u64,
    /// Uses so far: the time of the next one.
    time: u64,
    /// By their place in the file.
    segments: HashMap<u64, Cached>,
    /// Segments by the time of their last use. Going through all of them for the oldest would take a time
    /// that grows with the square of their number where a hostile file has very many small ones.
    by_time: BTreeMap<u64, u64>,
}

struct Cached {
    last_use: u64,
    bytes: Arc<Vec<u8>>,
}

impl SegmentCache {
    /// Holds at most so many bytes, but always the segment that was put last.
    pub fn new(limit: u64) -> SegmentCache {
        SegmentCache { limit, held: 0, time: 0, segments: HashMap::new(), by_time: BTreeMap::new() }
    }

    /// The bytes of a segment, if they are held.
    pub fn get(&mut self, offset: u64) -> Option<Arc<Vec<u8>>> {
        let cached = self.segments.get_mut(&offset)?;
        self.by_time.remove(&cached.last_use);
        self.by_time.insert(self.time, offset);
        cached.last_use = self.time;
        self.time += 1;
        Some(cached.bytes.clone())
    }

    /// Holds a segment, which may be there already if two threads have read it at the same time.
    pub fn put(&mut self, offset: u64, bytes: Arc<Vec<u8>>) {
        self.remove(offset);
        self.held += bytes.len() as u64;
        self.segments.insert(offset, Cached { last_use: self.time, bytes });
        self.by_time.insert(self.time, offset);
        self.time += 1;
        // The newest is the last of all by time, so that it is never what gives way.
        while self.held > self.limit && self.segments.len() > 1 {
            let Some((_, oldest)) = self.by_time.pop_first() else { return };
            self.remove(oldest);
        }
    }

    fn remove(&mut self, offset: u64) {
        if let Some(Cached { last_use, bytes }) = self.segments.remove(&offset) {
            self.by_time.remove(&last_use);
            self.held -= bytes.len() as u64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_used_for_longest_gives_way() {
        let mut cache = SegmentCache::new(10);
        let bytes = |length: usize| Arc::new(vec![0; length]);
        (0..3).for_each(|index| cache.put(index, bytes(3)));
        assert!(cache.get(0).is_some());
        cache.put(3, bytes(3));
        assert_eq!([0, 1, 2, 3].map(|index| cache.get(index).is_some()), [true, false, true, true]);
        // The same again takes its own room.
        cache.put(3, bytes(4));
        assert_eq!((cache.held, cache.segments.len(), cache.by_time.len()), (10, 3, 3));
        // One that is larger than all room is held alone.
        cache.put(4, bytes(20));
        assert_eq!((cache.held, cache.segments.len(), cache.by_time.len()), (20, 1, 1));
    }
}

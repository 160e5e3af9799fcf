//! Cache of decoded chunks that are likely to be needed again.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// Identity of a decoded chunk: offset and length of its bytes (`None` is the rest of the file),
/// and its rows. Chunks with equal keys have equal content, wherever they are in the image.
pub(super) type ChunkKey = (u64, Option<u64>, u64);

/// Chunks by their keys. The least recently used are evicted if they exceed the limit in bytes.
pub(super) struct ChunkCache {
    limit: u64,
    held: u64,
    clock: u64,
    chunks: HashMap<ChunkKey, (u64, Arc<Vec<u8>>)>,
    by_age: BTreeMap<u64, ChunkKey>,
}

impl ChunkCache {
    /// An empty cache for `limit` bytes.
    pub(super) fn new(limit: u64) -> ChunkCache {
        ChunkCache { limit, held: 0, clock: 0, chunks: HashMap::new(), by_age: BTreeMap::new() }
    }

    /// Whether a chunk is in the cache.
    pub(super) fn has(&self, chunk: ChunkKey) -> bool {
        self.chunks.contains_key(&chunk)
    }

    pub(super) fn get(&mut self, chunk: ChunkKey) -> Option<Arc<Vec<u8>>> {
        let (used, bytes) = self.chunks.get_mut(&chunk)?;
        self.by_age.remove(used);
        self.clock += 1;
        *used = self.clock;
        self.by_age.insert(self.clock, chunk);
        Some(Arc::clone(bytes))
    }

    /// Adds a chunk. Returns the memory of an evicted chunk, if any, for reuse.
    pub(super) fn put(&mut self, chunk: ChunkKey, bytes: Arc<Vec<u8>>) -> Vec<u8> {
        let mut gone = None;
        self.clock += 1;
        self.held += bytes.len() as u64;
        self.by_age.insert(self.clock, chunk);
        if let Some((used, old)) = self.chunks.insert(chunk, (self.clock, bytes)) {
            self.by_age.remove(&used);
            self.held -= old.len() as u64;
        }
        while self.held > self.limit && self.chunks.len() > 1 {
            let Some((_, oldest)) = self.by_age.pop_first() else { break };
            if let Some((_, bytes)) = self.chunks.remove(&oldest) {
                self.held -= bytes.len() as u64;
                gone = Arc::into_inner(bytes);
            }
        }
        gone.unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_recently_used_chunks_are_evicted_first() {
        let mut cache = ChunkCache::new(20);
        let chunk = |byte| Arc::new(vec![byte; 10]);
        let key = |number| (number, None, 10);
        assert!(cache.put(key(1), chunk(1)).is_empty());
        assert!(cache.put(key(2), chunk(2)).is_empty());
        assert!(cache.get(key(1)).is_some());
        assert_eq!(cache.put(key(3), chunk(3)), [2; 10]);
        assert!(cache.get(key(1)).is_some() && cache.get(key(2)).is_none() && cache.get(key(3)).is_some());
        // A chunk that exceeds the limit is kept alone.
        cache.put(key(4), Arc::new(vec![4; 30]));
        assert!(cache.get(key(4)).is_some() && cache.get(key(3)).is_none());
        assert_eq!((cache.held, cache.by_age.len()), (30, 1));
    }
}

//! Decoded chunks that will likely be asked for again.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// Chunks by number; those not used for longest go when there are too many bytes.
pub(super) struct ChunkCache {
    limit: u64,
    held: u64,
    clock: u64,
    chunks: HashMap<u64, (u64, Arc<Vec<u8>>)>,
    by_age: BTreeMap<u64, u64>,
}

impl ChunkCache {
    /// An empty cache for `limit` bytes.
    pub(super) fn new(limit: u64) -> ChunkCache {
        ChunkCache { limit, held: 0, clock: 0, chunks: HashMap::new(), by_age: BTreeMap::new() }
    }

    pub(super) fn get(&mut self, chunk: u64) -> Option<Arc<Vec<u8>>> {
        let (used, bytes) = self.chunks.get_mut(&chunk)?;
        self.by_age.remove(used);
        self.clock += 1;
        *used = self.clock;
        self.by_age.insert(self.clock, chunk);
        Some(Arc::clone(bytes))
    }

    /// Adds a chunk. Gives back the memory of one that had to go, if any, for the next chunk to use.
    pub(super) fn put(&mut self, chunk: u64, bytes: Arc<Vec<u8>>) -> Vec<u8> {
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
    fn chunks_not_used_for_longest_go_first() {
        let mut cache = ChunkCache::new(20);
        let chunk = |byte| Arc::new(vec![byte; 10]);
        assert!(cache.put(1, chunk(1)).is_empty());
        assert!(cache.put(2, chunk(2)).is_empty());
        assert!(cache.get(1).is_some());
        assert_eq!(cache.put(3, chunk(3)), [2; 10]);
        assert!(cache.get(1).is_some() && cache.get(2).is_none() && cache.get(3).is_some());
        // One that is larger than all room stays alone.
        cache.put(4, Arc::new(vec![4; 30]));
        assert!(cache.get(4).is_some() && cache.get(3).is_none());
        assert_eq!((cache.held, cache.by_age.len()), (30, 1));
    }
}

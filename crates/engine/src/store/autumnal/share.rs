//! Deduplication: finds records that are in the file already.

/// A table of records by 128-bit hashes, of bounded size: newer ones replace older ones. What it finds is
/// only likely to be the same: the caller compares.
pub(super) struct DedupTable {
    /// Two entries per slot: 64 bits of the hash, and what is known by it; 0 is nothing.
    table: Vec<[(u64, u64); 2]>,
}

impl DedupTable {
    /// A table of at most so many bytes.
    pub(super) fn new(memory: u64) -> DedupTable {
        let slots = (memory / 32).max(1024);
        // The largest power of two that fits.
        let slots = 1usize << slots.ilog2().min(40);
        DedupTable { table: vec![[(0, 0); 2]; slots] }
    }

    fn slot(&self, hash: u128) -> usize {
        hash as usize & (self.table.len() - 1)
    }

    /// Finds what may be known by a hash.
    pub(super) fn find(&self, hash: u128) -> impl Iterator<Item = u64> + use<> {
        let tag = (hash >> 64) as u64;
        self.table[self.slot(hash)]
            .into_iter()
            .filter(move |(other, known)| *known != 0 && *other == tag)
            .map(|(_, known)| known)
    }

    /// Remembers something that is not 0 by a hash.
    pub(super) fn insert(&mut self, hash: u128, known: u64) {
        debug_assert!(known != 0);
        let slot = self.slot(hash);
        let entries = &mut self.table[slot];
        // The newer of two moves to the second entry, the older is dropped: the table keeps its size.
        entries[1] = entries[0];
        entries[0] = ((hash >> 64) as u64, known);
    }
}

/// The hash of a record's content.
pub(super) fn hash(content: &[u8]) -> u128 {
    xxhash_rust::xxh3::xxh3_128(content)
}

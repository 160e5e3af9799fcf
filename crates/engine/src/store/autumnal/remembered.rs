//! Results for nodes, so that nodes that occur many times are processed once.

use std::collections::HashMap;
use std::hash::Hash;

/// Cache of results per node, with bounded memory. If it is full, results of the smallest nodes are
/// evicted first: their ancestors' results make them unnecessary.
pub(crate) struct Remembered<K, T> {
    /// Entries by height of their nodes.
    by_height: Vec<HashMap<K, T>>,
    /// Bytes used per height.
    taken: Vec<u64>,
    /// Memory limit in bytes.
    most: u64,
}

/// Maximum height of a node plus one.
const HEIGHTS: usize = 32;

impl<K: Eq + Hash, T> Remembered<K, T> {
    /// Creates an empty cache of `most` bytes.
    pub(crate) fn new(most: u64) -> Remembered<K, T> {
        let by_height = (0..HEIGHTS).map(|_| HashMap::new()).collect();
        Remembered { by_height, taken: vec![0; HEIGHTS], most }
    }

    /// Returns the result for a node of `height`.
    pub(crate) fn get(&self, height: u8, key: &K) -> Option<&T> {
        self.by_height.get(usize::from(height))?.get(key)
    }

    /// Stores the result for a node. It takes `more` bytes in addition to key and value.
    pub(crate) fn insert(&mut self, height: u8, key: K, known: T, more: u64) {
        let height = usize::from(height).min(HEIGHTS - 1);
        // (A hash table is about half full.)
        let bytes = 2 * (size_of::<(K, T)>() as u64 + 1) + more;
        while self.taken.iter().sum::<u64>() + bytes > self.most {
            let Some(lowest) = (0..height).find(|lower| self.taken[*lower] > 0) else { return };
            self.by_height[lowest] = HashMap::new();
            self.taken[lowest] = 0;
        }
        if self.by_height[height].insert(key, known).is_none() {
            self.taken[height] += bytes;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_nodes_are_forgotten_first() {
        let bytes = 2 * (size_of::<(u64, u8)>() as u64 + 1) + 100;
        let mut known = Remembered::new(10 * bytes);
        (0..8u64).for_each(|key| known.insert(3, key, 1u8, 100));
        (0..4).for_each(|key| known.insert(5, key, 2, 100));
        assert_eq!((known.get(3, &0), known.get(3, &7), known.get(5, &0)), (None, None, Some(&2)));
        // Smaller ones only use the remaining space.
        (0..20).for_each(|key| known.insert(4, key, 3, 100));
        assert_eq!((known.get(4, &5), known.get(4, &6), known.get(5, &3)), (Some(&3), None, Some(&2)));
    }
}

//! Node counts by level and state.

use serde::{Deserialize, Serialize};

use crate::INNER;

/// Node counts per level. A VOID or LEAF node counts only at its own level, not again at deeper
/// levels.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LevelCounts {
    levels: Vec<[u64; 3]>,
}

impl LevelCounts {
    /// Counts of VOID, LEAF and INNER nodes of each level, from the root down.
    #[inline]
    pub fn levels(&self) -> &[[u64; 3]] {
        &self.levels
    }

    /// Adds counts of VOID, LEAF and INNER nodes at a level.
    #[inline]
    pub fn add(&mut self, level: u8, nodes: [u64; 3]) {
        let level = level as usize;
        // Keeps the deepest level with nodes as the last one.
        if nodes == [0; 3] {
            return;
        }
        if self.levels.len() <= level {
            self.levels.resize(level + 1, [0; 3]);
        }
        for (sum, more) in self.levels[level].iter_mut().zip(nodes) {
            *sum += more;
        }
    }

    /// Adds the counts of another subtree with the same root level.
    #[inline]
    pub fn merge(&mut self, other: &LevelCounts) {
        self.merge_below(0, other);
    }

    /// Adds the counts of a subtree whose root is at `level`.
    #[inline]
    pub fn merge_below(&mut self, level: u8, other: &LevelCounts) {
        for (below, nodes) in other.levels.iter().enumerate() {
            self.add(level + below as u8, *nodes);
        }
    }

    /// Number of INNER nodes of all levels, which is the number of records.
    #[inline]
    pub fn records(&self) -> u64 {
        self.levels.iter().fold(0, |sum, level| sum.saturating_add(level[usize::from(INNER)]))
    }
}

//! Numbers of nodes by level and state.

use serde::{Deserialize, Serialize};

use crate::INNER;

/// Nodes per level. A VOID or LEAF node is counted where it stands, not again at deeper levels.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LevelCounts {
    levels: Vec<[u64; 3]>,
}

impl LevelCounts {
    /// VOID, LEAF and INNER nodes of each level, the root first.
    #[inline]
    pub fn levels(&self) -> &[[u64; 3]] {
        &self.levels
    }

    /// Adds VOID, LEAF and INNER nodes at a level.
    #[inline]
    pub fn add(&mut self, level: u8, nodes: [u64; 3]) {
        let level = level as usize;
        // So that the list ends at the deepest level that has nodes.
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

    /// Adds all of another tree part's counts.
    #[inline]
    pub fn merge(&mut self, other: &LevelCounts) {
        self.merge_below(0, other);
    }

    /// Adds counts that begin with a node at `level`.
    #[inline]
    pub fn merge_below(&mut self, level: u8, other: &LevelCounts) {
        for (below, nodes) in other.levels.iter().enumerate() {
            self.add(level + below as u8, *nodes);
        }
    }

    /// INNER nodes of all levels: the records of the tree.
    #[inline]
    pub fn records(&self) -> u64 {
        self.levels.iter().fold(0, |sum, level| sum.saturating_add(level[usize::from(INNER)]))
    }
}

//! Nodes per level, which nobody keeps up to date in a file that is edited: they are counted.

use super::reader::{Autumnal, Node};
use crate::Result;
use crate::store::container::LevelCounts;
use crate::tree::{Child, Source, no_children};

impl Autumnal {
    /// Nodes of the commit's tree by level and state, those of shared subtrees as often as they occur; `None` if it has
    /// more than `most` records, each of which is read.
    ///
    /// # Errors
    /// If the file is damaged.
    pub fn level_counts(&self, most: u64) -> Result<Option<LevelCounts>> {
        let mut counts = LevelCounts::default();
        let mut left = most;
        let is_counted = self.count_levels(self.root_child(), 0, &mut counts, &mut left)?;
        Ok(is_counted.then_some(counts))
    }

    /// Counts a node and all below it, as long as records are left; tells whether that was enough.
    fn count_levels(
        &self,
        node: Child<Node>,
        level: u8,
        counts: &mut LevelCounts,
        left: &mut u64,
    ) -> Result<bool> {
        let mut nodes = [0; 3];
        nodes[node.state() as usize] = 1;
        counts.add(level, nodes);
        let Child::Inner { node, .. } = node else { return Ok(true) };
        let Some(less) = left.checked_sub(1) else { return Ok(false) };
        *left = less;
        let mut children = no_children();
        self.children(&node, &mut children)?;
        for child in &children[..self.form().children()] {
            if !self.count_levels(*child, level + 1, counts, left)? {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

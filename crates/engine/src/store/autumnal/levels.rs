//! Node counts per level. Edits do not maintain them, so they are counted.

use super::distinct::OccurrenceVisitor;
use super::node::AutumnalNode;
use super::reader::Autumnal;
use crate::tree::{Child, NodeState, Source, no_children};
use spinney_base::space::Bounds;
use spinney_base::value::Value;
use spinney_base::{Progress, Result};
use spinney_container::LevelCounts;

impl Autumnal {
    /// Counts the nodes of the commit's tree by level and state. Nodes of shared subtrees count
    /// once per occurrence. Returns `None` if the tree has more than `most` records, each of which
    /// is read. (If the tree has more nodes than the file has space for, each shared record is read
    /// once instead, and `most` does not apply.)
    ///
    /// # Errors
    /// If the file is corrupt, or on cancellation.
    pub fn level_counts(&self, most: u64, progress: &dyn Progress) -> Result<Option<LevelCounts>> {
        let root = self.root_child();
        if self.is_folded()? {
            let mut counted = Counted { depth: self.depth(), counts: LevelCounts::default(), progress };
            self.each_distinct(&Bounds::space(self.form().dimension, self.depth()), &mut counted)?;
            return Ok(Some(counted.counts));
        }
        let mut counts = LevelCounts::default();
        let mut left = most;
        let is_counted = self.count_levels(root, 0, &mut counts, &mut left, progress)?;
        Ok(is_counted.then_some(counts))
    }

    /// Counts a node and its descendants while `left` records remain, and returns whether they
    /// sufficed.
    fn count_levels(
        &self,
        node: Child<AutumnalNode>,
        level: u8,
        counts: &mut LevelCounts,
        left: &mut u64,
        progress: &dyn Progress,
    ) -> Result<bool> {
        counts.add(level, nodes_of(node.state(), 1));
        let Child::Inner { node, .. } = node else { return Ok(true) };
        let Some(less) = left.checked_sub(1) else { return Ok(false) };
        *left = less;
        progress.check()?;
        let mut children = no_children();
        self.children(&node, &mut children)?;
        for child in &children[..self.form().children()] {
            if !self.count_levels(*child, level + 1, counts, left, progress)? {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// Returns the counts of `nodes` nodes of one state.
fn nodes_of(state: NodeState, nodes: u64) -> [u64; 3] {
    let mut of = [0; 3];
    of[state as usize] = nodes;
    of
}

/// Counter of a tree whose records are each read once.
struct Counted<'p> {
    depth: u8,
    counts: LevelCounts,
    progress: &'p dyn Progress,
}

impl OccurrenceVisitor for Counted<'_> {
    fn inner(&mut self, node: AutumnalNode, times: u64) -> Result<bool> {
        self.progress.check()?;
        self.counts.add(self.depth - node.height, nodes_of(NodeState::Inner, times));
        Ok(true)
    }

    fn uniform(&mut self, value: Option<Value>, levels: u8, times: u64, _: u64) -> Result<()> {
        let state = if value.is_some() { NodeState::Leaf } else { NodeState::Void };
        self.counts.add(self.depth - levels, nodes_of(state, times));
        Ok(())
    }
}

//! Copied records of whole stored subtrees, which are not traversed node by node.

use crate::store::records::RecordLayout;
use crate::store::records::subtree::count_nodes;
use spinney_container::{LevelCounts, VOID};

/// A node with copied records.
#[derive(Clone, Copy)]
pub(super) struct ReusedNode {
    /// Its index in its level.
    pub(super) index: u32,
    /// Index of its first record among all copied ones, and number of its records.
    start: u32,
    pub(super) len: u32,
    /// Whether some of its cells are VOID.
    pub(super) has_void: bool,
}

/// Copied records of one block.
pub(super) struct ReusedRecords {
    layout: RecordLayout,
    /// Levels of the block.
    height: u8,
    records: Vec<u8>,
    /// Number of nodes in the copied subtrees, by level; the block's root is at level 0.
    pub(super) counts: LevelCounts,
}

impl ReusedRecords {
    pub(super) fn new(layout: RecordLayout, height: u8) -> Self {
        ReusedRecords { layout, height, records: Vec::new(), counts: LevelCounts::default() }
    }

    /// Copies a subtree of `levels` levels, for the node at `index` of its level. `None` if its
    /// records are inconsistent; the slower node-by-node path then reports the error.
    pub(super) fn take(&mut self, index: usize, subtree: &[u8], levels: u8) -> Option<ReusedNode> {
        let mut counts = LevelCounts::default();
        count_nodes(self.layout, subtree, levels, self.height - levels, &mut counts).ok()?;
        let has_void = counts.levels().iter().any(|nodes| nodes[usize::from(VOID)] > 0);
        self.counts.merge(&counts);
        let start = self.layout.count(&self.records) as u32;
        self.records.extend_from_slice(subtree);
        Some(ReusedNode { index: index as u32, start, len: self.layout.count(subtree) as u32, has_void })
    }

    /// Returns the records of a node.
    pub(super) fn records(&self, node: &ReusedNode) -> &[u8] {
        let size = self.layout.size;
        &self.records[node.start as usize * size..][..node.len as usize * size]
    }
}

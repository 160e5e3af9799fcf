//! Records of whole subtrees that files have stored, taken over instead of going through them node by node.

use crate::store::records::RecordLayout;
use crate::store::records::subtree::count_nodes;
use spinney_container::{LevelCounts, VOID};

/// A node whose records are taken over.
#[derive(Clone, Copy)]
pub(super) struct ReusedNode {
    /// Its index in its level.
    pub(super) index: u32,
    /// Index of its first record among all that were taken over, and their number.
    start: u32,
    pub(super) len: u32,
    /// Whether some of its cells are VOID.
    pub(super) has_void: bool,
}

/// Records that are taken over for one block.
pub(super) struct ReusedRecords {
    layout: RecordLayout,
    /// Levels of the block.
    height: u8,
    records: Vec<u8>,
    /// Nodes below what was taken over; the block's root is at level 0.
    pub(super) counts: LevelCounts,
}

impl ReusedRecords {
    pub(super) fn new(layout: RecordLayout, height: u8) -> Self {
        ReusedRecords { layout, height, records: Vec::new(), counts: LevelCounts::default() }
    }

    /// Takes over a subtree with so many levels whose root has an index in its level; `None` if its records
    /// contradict each other: going through it the usual way tells what is wrong.
    pub(super) fn take(&mut self, index: usize, subtree: &[u8], levels: u8) -> Option<ReusedNode> {
        let mut counts = LevelCounts::default();
        count_nodes(self.layout, subtree, levels, self.height - levels, &mut counts).ok()?;
        let has_void = counts.levels().iter().any(|nodes| nodes[usize::from(VOID)] > 0);
        self.counts.merge(&counts);
        let start = self.layout.count(&self.records) as u32;
        self.records.extend_from_slice(subtree);
        Some(ReusedNode { index: index as u32, start, len: self.layout.count(subtree) as u32, has_void })
    }

    /// The records of one of the nodes.
    pub(super) fn records(&self, node: &ReusedNode) -> &[u8] {
        let size = self.layout.size;
        &self.records[node.start as usize * size..][..node.len as usize * size]
    }
}

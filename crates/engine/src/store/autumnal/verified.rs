//! Set of verified nodes, so that shared subtrees are verified once.

use std::sync::{Mutex, MutexGuard, PoisonError};

use super::node::AutumnalNode;
use super::reader::Autumnal;
use super::remembered::Remembered;
use crate::store::builder::{RecordRef, ReusableSource};
use crate::tree::{CellBlock, Child, Children, Source};
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::value::ZoneStats;

/// Nodes with zones that were verified with all their descendants. Nodes that exceed the memory
/// limit are verified again.
pub(super) struct Verified(Mutex<Remembered<u64, ()>>);

impl Verified {
    /// Creates an empty set that may use `memory` bytes.
    pub(super) fn new(memory: u64) -> Verified {
        Verified(Mutex::new(Remembered::new(memory)))
    }

    fn nodes(&self) -> MutexGuard<'_, Remembered<u64, ()>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn insert(&self, node: AutumnalNode) {
        self.nodes().insert(node.height, node.address, (), 0);
    }

    pub(super) fn contains(&self, node: AutumnalNode) -> bool {
        self.nodes().get(node.height, &node.address).is_some()
    }
}

/// A tree as a source that reads each record once. The number of its nodes is therefore not
/// limited.
pub(super) struct Unverified<'a> {
    pub(super) tree: &'a Autumnal,
}

impl Source for Unverified<'_> {
    type Node = AutumnalNode;

    fn form(&self) -> TreeType {
        self.tree.form()
    }

    fn depth(&self) -> u8 {
        self.tree.depth()
    }

    fn root(&self) -> Result<Child<AutumnalNode>> {
        // (No limit on the node count: each record is read once.)
        Ok(self.tree.root_child())
    }

    fn children(&self, node: &AutumnalNode, children: &mut Children<AutumnalNode>) -> Result<()> {
        self.tree.children(node, children)
    }

    fn cells(&self, node: &AutumnalNode, levels: u8) -> Result<Option<CellBlock>> {
        self.tree.cells(node, levels)
    }

    fn check_unchanged(&self) -> Result<()> {
        self.tree.check_unchanged()
    }

    fn tally(&self, node: &AutumnalNode) -> Result<Option<ZoneStats>> {
        self.tree.tally(node)
    }
}

impl ReusableSource for Unverified<'_> {
    fn kept(&self, node: &AutumnalNode) -> Option<RecordRef> {
        self.tree.kept(node)
    }
}

//! Nodes that were looked at, so that what commits, or parts of a tree, have in common is looked at once.

use std::sync::{Mutex, MutexGuard, PoisonError};

use super::node::AutumnalNode;
use super::reader::Autumnal;
use super::remembered::Remembered;
use crate::store::builder::{RecordRef, ReusableSource};
use crate::tree::{CellBlock, Child, Children, Source};
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::value::ZoneStats;

/// Nodes with zones that were looked at, with all that is below them. Those for which there is no room are looked at again.
pub(super) struct Verified(Mutex<Remembered<u64, ()>>);

impl Verified {
    /// None yet, and room for as many as fit into so many bytes.
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

/// A tree as a source each record of which is looked at once, so that it may have any number of nodes.
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
        // (However many nodes there are: each record is looked at once.)
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

//! Nodes that were found to be good, so that what commits, or parts of a tree, have in common is looked at once.

use std::collections::HashSet;
use std::sync::Mutex;

use super::reader::{Autumnal, Node};
use crate::Result;
use crate::store::builder::{RecordRef, ReusableSource};
use crate::tree::{CellBlock, Child, Children, Form, Source};
use crate::value::Tally;

/// Nodes with zones that were found to be good, with all that is below them.
pub(super) struct Verified {
    nodes: Mutex<HashSet<Node>>,
    /// Nodes that may be kept in memory. Those beyond are looked at again, which costs nothing but time.
    most: usize,
}

/// Bytes that a node takes in memory, in a table that is half full.
const NODE_SIZE: u64 = 2 * (size_of::<Node>() as u64 + 1);

impl Verified {
    /// None yet, and room for as many as fit into so many bytes.
    pub(super) fn new(memory: u64) -> Verified {
        Verified { nodes: Mutex::default(), most: (memory / NODE_SIZE) as usize }
    }

    pub(super) fn insert(&self, node: Node) {
        let mut nodes = self.nodes.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if nodes.len() < self.most {
            nodes.insert(node);
        }
    }

    fn contains(&self, node: Node) -> bool {
        self.nodes.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).contains(&node)
    }
}

/// A tree as a source of which only what was not verified yet is looked at.
pub(super) struct Unverified<'a> {
    pub(super) tree: &'a Autumnal,
    pub(super) verified: &'a Verified,
}

impl Source for Unverified<'_> {
    type Node = Node;

    fn form(&self) -> Form {
        self.tree.form()
    }

    fn depth(&self) -> u8 {
        self.tree.depth()
    }

    fn root(&self) -> Result<Child<Node>> {
        self.tree.root()
    }

    fn children(&self, node: &Node, children: &mut Children<Node>) -> Result<()> {
        self.tree.children(node, children)
    }

    fn cells(&self, node: &Node, levels: u8) -> Result<Option<CellBlock>> {
        self.tree.cells(node, levels)
    }

    fn check_unchanged(&self) -> Result<()> {
        self.tree.check_unchanged()
    }

    fn tally(&self, node: &Node) -> Result<Option<Tally>> {
        self.tree.tally(node)
    }
}

impl ReusableSource for Unverified<'_> {
    fn kept(&self, node: &Node) -> Option<RecordRef> {
        if self.verified.contains(*node) { self.tree.kept(node) } else { None }
    }
}

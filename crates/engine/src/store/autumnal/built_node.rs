//! Nodes of an Autumnal file in progress.

use super::layout::Pointers;
use crate::store::builder::EncodedSubtree;

/// A node with the data that records above it need, and pointers for its own or its ancestor's
/// record.
#[derive(Clone)]
pub(super) struct BuiltNode {
    pub(super) subtree: EncodedSubtree,
    /// Pointers to the next nodes with records below, or to the node itself.
    pub(super) pointers: Pointers,
}

impl BuiltNode {
    /// Creates a node without pointers.
    pub(super) fn new(subtree: EncodedSubtree) -> BuiltNode {
        BuiltNode { subtree, pointers: Pointers::default() }
    }
}

//! Nodes of an Autumnal file that is being written.

use super::layout::Pointers;
use crate::store::builder::Part;

/// A node, what records above it need of what is below, and the records in the file that its own, or that above, points to.
#[derive(Clone)]
pub(super) struct BuiltNode {
    pub(super) part: Part,
    /// To the nodes with records that come next below, or to the node itself.
    pub(super) pointers: Pointers,
}

impl BuiltNode {
    /// A node without pointers.
    pub(super) fn new(part: Part) -> BuiltNode {
        BuiltNode { part, pointers: Pointers::default() }
    }
}

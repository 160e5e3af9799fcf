//! Nodes of an open Autumnal file.

use crate::store::records::RunNode;

/// An INNER node of an open file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct AutumnalNode {
    /// Offset in the file of the record that has it.
    pub(super) address: u64,
    /// Levels below it.
    pub(super) height: u8,
    /// The way to it from the record's own node: the numbers of children, one after the other as digits.
    pub(super) path: u8,
    /// Its place in the record's run.
    pub(super) place: RunNode,
}

impl AutumnalNode {
    /// The node whose own record is at an address.
    #[inline]
    pub(super) fn new(address: u64, height: u8) -> AutumnalNode {
        AutumnalNode { address, height, path: 0, place: RunNode::default() }
    }

    /// Whether the node has a record of its own.
    #[inline]
    pub(crate) fn has_record(&self) -> bool {
        self.place == RunNode::default()
    }
}

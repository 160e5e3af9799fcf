//! Nodes of an open Autumnal file.

use crate::store::records::RunNode;

/// An INNER node of an open file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct AutumnalNode {
    /// File offset of the record that contains it.
    pub(super) address: u64,
    /// Number of levels below it.
    pub(super) height: u8,
    /// Path from the record's own node: child numbers as digits, the first one highest.
    pub(super) path: u8,
    /// Its location in the record's run.
    pub(super) place: RunNode,
}

impl AutumnalNode {
    /// Creates the node whose own record is at `address`.
    #[inline]
    pub(super) fn new(address: u64, height: u8) -> AutumnalNode {
        AutumnalNode { address, height, path: 0, place: RunNode::default() }
    }

    /// Returns whether the node has a record of its own.
    #[inline]
    pub(crate) fn has_record(&self) -> bool {
        self.place == RunNode::default()
    }
}

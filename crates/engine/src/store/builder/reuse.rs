//! Sources that tell which of their subtrees are stored in files, and need not be built anew.

use super::merge::Overlay;
use super::stored_node::{RecordRef, StoredNode};
use crate::tree::{MemTree, Source};

/// A source that may tell which of its nodes are stored in files.
pub trait ReusableSource: Source {
    /// The node with a record in a run that an INNER node is, with all that is below it, if it is one: the records that
    /// are stored may then be copied.
    fn stored(&self, _: &Self::Node) -> Option<StoredNode<'_>> {
        None
    }

    /// The node of an Autumnal file that an INNER node is, with all that is below it, if it is one: the file
    /// need not be written that again.
    fn kept(&self, _: &Self::Node) -> Option<RecordRef> {
        None
    }

    /// The nodes of two files that an INNER node is made of, if it is no more than these, merged: the builder
    /// may then merge them itself, record by record.
    fn overlay(&self, _: &Self::Node) -> Option<Overlay<'_>> {
        None
    }
}

impl ReusableSource for MemTree {}

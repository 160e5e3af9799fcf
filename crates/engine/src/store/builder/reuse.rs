//! Sources that know which of their subtrees are stored in files and can be reused instead of
//! built.

use super::merge::Overlay;
use super::stored_node::{RecordRef, StoredNode};
use crate::tree::{MemTree, Source};

/// A source that may know which of its nodes are stored in files.
pub trait ReusableSource: Source {
    /// Returns the stored node that an INNER node and its subtree are identical to, if there is one
    /// with a record in a run. The stored records may then be copied.
    fn stored(&self, _: &Self::Node) -> Option<StoredNode<'_>> {
        None
    }

    /// Returns the record of an Autumnal file that an INNER node and its subtree are identical to,
    /// if there is one. It need not be written to that file again, if the layer that is written
    /// computes representatives and zones as the record's layer does. The record's layer has the
    /// source's tree type.
    fn kept(&self, _: &Self::Node) -> Option<RecordRef> {
        None
    }

    /// Returns the nodes of two files that an INNER node is the merge of, if it is exactly that.
    /// The builder may then merge them itself, record by record.
    fn overlay(&self, _: &Self::Node) -> Option<Overlay<'_>> {
        None
    }
}

impl ReusableSource for MemTree {}

//! Where finished segments go.

use std::path::Path;

use super::directory::Entry;
use crate::store::builder::{Part, SealedSegment};
use spinney_base::Result;
use spinney_container::Codec;

/// Receives the segments of a tree as they are finished, a node's before its ancestors'.
pub(super) trait SegmentSink: Send {
    /// The file, for messages.
    fn path(&self) -> &Path;

    /// The level down to which others merge what comes: parts of nodes there, or above, go to [`SegmentSink::top`]. None where a whole
    /// tree is made.
    fn stop(&self) -> Option<u8> {
        None
    }

    /// Takes the part of a node that somebody else merges with its siblings.
    fn top(&mut self, _: Part) -> Result<()> {
        unreachable!("a whole tree has its root on top")
    }

    /// The codec of the segments that come.
    fn codec(&self) -> Codec;

    /// Takes one segment.
    fn segment(&mut self, segment: SealedSegment) -> Result<()>;

    /// Makes sure that what it was given is on the disk, as far as it keeps it in the order in which it came.
    fn sync(&mut self) -> Result<()> {
        Ok(())
    }

    /// Takes the bytes of one segment of another file as they are to be written; the entry has the code it gets.
    fn copy(&mut self, bytes: &[u8], entry: Entry) -> Result<()>;
}

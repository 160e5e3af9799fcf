//! Sinks of finished segments.

use std::path::Path;

use super::directory::Entry;
use crate::store::builder::{EncodedSubtree, SealedSegment};
use spinney_base::Result;
use spinney_container::Codec;

/// Receives the segments of a tree as they are finished, a node's before its ancestors'.
pub(super) trait SegmentSink: Send {
    /// Returns the file, for messages.
    fn path(&self) -> &Path;

    /// Returns the level at which merging stops: parts of nodes at this level or above it go to
    /// [`SegmentSink::top`]. `None` if a whole tree is built.
    fn stop(&self) -> Option<u8> {
        None
    }

    /// Receives the part of a node that is merged with its siblings later.
    fn top(&mut self, _: EncodedSubtree) -> Result<()> {
        unreachable!("a whole tree has its root on top")
    }

    /// Returns the codec of the segments that it receives.
    fn codec(&self) -> Codec;

    /// Receives one segment.
    fn segment(&mut self, segment: SealedSegment) -> Result<()>;

    /// Makes the received segments durable, except for those that are written later.
    fn sync(&mut self) -> Result<()> {
        Ok(())
    }

    /// Receives the bytes of one segment of another file, to be written unchanged. The entry has
    /// the new code.
    fn copy(&mut self, bytes: &[u8], entry: Entry) -> Result<()>;
}

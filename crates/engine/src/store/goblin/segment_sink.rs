//! Where finished segments go.

use super::directory::Entry;
use crate::store::builder::SealedSegment;
use spinney_base::Result;
use spinney_packing::Effort;

/// Receives the segments of a tree as they are finished, a node's before its ancestors'.
pub(super) trait SegmentSink: Send {
    /// The effort of packing the segments that come; none where they are to stay plain.
    fn effort(&self) -> Option<Effort>;

    /// Takes one segment.
    fn segment(&mut self, segment: SealedSegment) -> Result<()>;

    /// Takes the bytes of one segment of another file as they are to be written; the entry has the code it gets.
    fn copy(&mut self, bytes: &[u8], entry: Entry) -> Result<()>;
}

//! Where finished segments go.

use super::directory::Entry;
use super::segment::Segment;
use crate::store::builder::SealedSegment;
use spinney_base::Result;

/// Receives the segments of a tree as they are finished, a node's before its ancestors'.
pub(super) trait SegmentSink: Send {
    /// Takes one segment.
    fn segment(&mut self, segment: SealedSegment) -> Result<()>;

    /// Takes one segment of another file as it is; the entry has the code it gets.
    fn copy(&mut self, segment: &Segment<'_>, entry: Entry) -> Result<()>;
}

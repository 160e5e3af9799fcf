//! Merges blocks into the segments of a Goblin file, in whatever order they are pushed.

use super::directory::Entry;
use super::packed::pack_sealed;
use super::segment_copy::SegmentCopy;
use super::segment_sink::SegmentSink;
use crate::store::builder::{BuiltBlock, EncodedSubtree, SealedSegment, Siblings, StoredNode, TreeSink};
use crate::store::records::subtree::BadSkip;
use spinney_base::parallel;
use spinney_base::space::Code;
use spinney_base::value::{Rule, Value};
use spinney_base::{Error, Result};
use spinney_container::{Codec, Header, LevelCounts};

/// Merges parts whose siblings are complete, seals segments, and passes them to a sink.
pub(super) struct SegmentBuilder<'k> {
    header: Header,
    siblings: Siblings<EncodedSubtree>,
    root: Option<EncodedSubtree>,
    /// The level above which nothing is merged, if only a shard of a tree is built.
    stop: Option<u8>,
    counts: LevelCounts,
    /// Segments to be packed, in order: all threads pack those of a batch.
    unpacked: Vec<SealedSegment>,
    sink: &'k mut dyn SegmentSink,
}

/// Panic message for a missing root, which cannot occur, since all cells of a tree are pushed.
pub(super) const ALL_HAS_COME: &str = "all blocks were pushed";

/// Panic message for a case that [`TreeSink::can_copy`] excludes.
const CAN_BE_COPIED: &str = "only what can be copied is";

impl<'k> SegmentBuilder<'k> {
    /// Returns a builder for the tree of a header. `covered` is the extent of the parts that will
    /// be pushed; all cells outside are VOID.
    pub(super) fn new(header: &Header, covered: [u64; 3], sink: &'k mut dyn SegmentSink) -> Self {
        let siblings = Siblings::new(header.form.dimension, header.depth(), covered);
        let (header, counts, stop) = (header.clone(), LevelCounts::default(), sink.stop());
        SegmentBuilder { header, siblings, root: None, stop, counts, unpacked: Vec::new(), sink }
    }

    /// Writes a finished segment; its node's part is pushed later.
    pub(super) fn pass(&mut self, bytes: &[u8], entry: Entry) -> Result<()> {
        self.sink.copy(bytes, entry)
    }

    /// Makes segments that were passed on durable.
    pub(super) fn sync(&mut self) -> Result<()> {
        self.sink.sync()
    }

    /// Adds the next segment: to be packed with others, or written immediately.
    fn segment(&mut self, segment: SealedSegment) -> Result<()> {
        match self.sink.codec() {
            Codec::Packed | Codec::Reference => self.unpacked.push(segment),
            Codec::Plain => self.sink.segment(segment)?,
        }
        Ok(())
    }

    /// Packs the segments that wait for it, and passes them to the sink.
    fn pack(&mut self) -> Result<()> {
        let segments = std::mem::take(&mut self.unpacked);
        let packed = parallel::map(&segments, |segment| pack_sealed(&self.header, segment));
        let mut both = segments.into_iter().zip(packed);
        both.try_for_each(|(segment, packed)| self.sink.segment(SealedSegment { packed, ..segment }))
    }

    /// Adds a block whose segments are not packed yet.
    fn add(&mut self, (part, sealed, counts): BuiltBlock) -> Result<()> {
        self.counts.merge(&counts);
        if let Some(sealed) = sealed {
            self.segment(sealed)?;
        }
        self.join(part)
    }

    /// Adds a part whose own segment has been removed.
    fn join(&mut self, mut part: EncodedSubtree) -> Result<()> {
        // The last of some siblings completes their parent, which may be the last again.
        loop {
            if self.stop.is_some_and(|stop| part.code.level() <= stop) {
                return self.sink.top(part);
            }
            let Some(parent) = part.code.parent() else {
                let mut root = [0; 3];
                root[part.child.state() as usize] = 1;
                self.counts.add(0, root);
                self.root = Some(part);
                return Ok(());
            };
            let (depth, value_type) = (self.header.depth(), self.header.form.value);
            let step = part.code.step(parent.level());
            let void = |code| EncodedSubtree::uniform(code, depth, value_type, None, false);
            let Some(parts) = self.siblings.join(parent, step, part, void) else { return Ok(()) };
            part = EncodedSubtree::merge(parent, &parts, depth, self.header.rule, &mut self.counts);
            // Invariant: segments are sealed in postorder, each node's before its ancestors', since
            // a part waits for its siblings and a parent is merged from complete ones. So one pass
            // over the cells is one pass over the file, and only records that nodes above still
            // need are kept.
            let sealed = part.seal(&self.header.shape).map_err(|BadSkip| {
                let place = format!("records below node {parent}");
                Error::corrupt(self.sink.path(), place, "inconsistent skips", "the skips of a tree")
            })?;
            if let Some(sealed) = sealed {
                self.segment(sealed)?;
            }
        }
    }

    /// Returns the root, if all parts of a whole tree were pushed, and the node counts per level.
    pub(super) fn finish(self) -> (Option<EncodedSubtree>, LevelCounts) {
        (self.root, self.counts)
    }
}

impl TreeSink for SegmentBuilder<'_> {
    fn push(&mut self, built: BuiltBlock) -> Result<()> {
        self.push_all(vec![built])
    }

    fn push_all(&mut self, built: Vec<BuiltBlock>) -> Result<()> {
        built.into_iter().try_for_each(|built| self.add(built))?;
        self.pack()
    }

    fn can_copy(&self, code: Code, node: &StoredNode<'_>) -> Result<bool> {
        // A shard does not write the nodes above its level.
        if self.stop.is_some_and(|stop| code.level() < stop) {
            return Ok(false);
        }
        // (Majorities above it need the counts of all classes.)
        let needs_classes = self.header.rule == Rule::Majority;
        SegmentCopy::is_possible(node, code, (self.header.form, &self.header.shape), needs_classes)
    }

    fn copy(&mut self, code: Code, representative: Value, node: &StoredNode<'_>) -> Result<()> {
        let copy = SegmentCopy::of(node, code)?.expect(CAN_BE_COPIED);
        let counts = copy.send(&self.header, self.sink)?;
        self.counts.merge(&counts);
        self.join(copy.part(representative, &self.header.shape)?)?;
        self.pack()
    }
}

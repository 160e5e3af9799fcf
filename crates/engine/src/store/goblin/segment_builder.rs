//! Puts blocks together to the segments of a Goblin file, in whatever order they come.

use super::segment_copy::SegmentCopy;
use super::segment_sink::SegmentSink;
use crate::store::builder::{BuiltBlock, Part, Siblings, StoredNode, TreeSink};
use spinney_base::Form;
use spinney_base::Result;
use spinney_base::space::Code;
use spinney_base::value::{Rule, Value};
use spinney_container::{Header, LevelCounts, Shape};

/// Merges parts whose siblings are complete, seals segments, and hands them to a sink.
pub(super) struct SegmentBuilder<'k> {
    form: Form,
    shape: Shape,
    rule: Rule,
    siblings: Siblings<Part>,
    root: Option<Part>,
    counts: LevelCounts,
    sink: &'k mut dyn SegmentSink,
}

/// Message of an error that [`TreeSink::can_copy`] excludes.
const CAN_BE_COPIED: &str = "only what can be copied is";

impl<'k> SegmentBuilder<'k> {
    /// For the tree of a header. `covered` is the extent of the parts that will come; what is outside is
    /// VOID.
    pub(super) fn new(header: &Header, covered: [u64; 3], sink: &'k mut dyn SegmentSink) -> Self {
        let Header { form, shape, rule, .. } = *header;
        let siblings = Siblings::new(form.dimension, shape.depth, covered);
        SegmentBuilder { form, shape, rule, siblings, root: None, counts: LevelCounts::default(), sink }
    }

    /// Takes a part whose own segment is already taken off.
    fn join(&mut self, mut part: Part) -> Result<()> {
        // A part that is the last of its siblings makes their parent, which may again be the last.
        loop {
            let Some(parent) = part.code.parent() else {
                let mut root = [0; 3];
                root[part.child.state() as usize] = 1;
                self.counts.add(0, root);
                self.root = Some(part);
                return Ok(());
            };
            let (depth, value_type) = (self.shape.depth, self.form.value);
            let step = part.code.step(parent.level());
            let void = |code| Part::uniform(code, depth, value_type, None, false);
            let Some(parts) = self.siblings.join(parent, step, part, void) else { return Ok(()) };
            part = Part::merge(parent, &parts, depth, self.rule, &mut self.counts);
            // Invariant: segments are sealed in postorder, each node's before its ancestors', since a part
            // waits for its siblings, and a parent is made of complete ones. So one pass over the cells is
            // one pass over the file, and what is kept of a subtree is what those above still need.
            if let Some(sealed) = part.seal(&self.shape) {
                self.sink.segment(sealed)?;
            }
        }
    }

    /// The root and the nodes per level, once all parts have come.
    pub(super) fn finish(self) -> (Part, LevelCounts) {
        (self.root.expect("all blocks were pushed"), self.counts)
    }
}

impl TreeSink for SegmentBuilder<'_> {
    fn push(&mut self, (part, sealed, counts): BuiltBlock) -> Result<()> {
        self.counts.merge(&counts);
        if let Some(sealed) = sealed {
            self.sink.segment(sealed)?;
        }
        self.join(part)
    }

    fn can_copy(&self, code: Code, node: &StoredNode<'_>) -> Result<bool> {
        // (Majorities above it are made of the counts of all classes.)
        let needs_classes = self.rule == Rule::Majority;
        SegmentCopy::is_possible(node, code, self.form, &self.shape, needs_classes)
    }

    fn copy(&mut self, code: Code, representative: Value, node: &StoredNode<'_>) -> Result<()> {
        let copy = SegmentCopy::of(node, code)?.expect(CAN_BE_COPIED);
        let counts = copy.send(self.sink)?;
        self.counts.merge(&counts);
        self.join(copy.part(representative, &self.shape)?)
    }
}

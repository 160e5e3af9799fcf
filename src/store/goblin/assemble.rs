//! Puts blocks together to a tree, in whatever order they come.

use std::collections::HashMap;

use super::counts::LevelCounts;
use super::directory::Entry;
use super::part::{Part, Sealed};
use super::record::Layout;
use super::segment::Segment;
use super::shape::Shape;
use crate::Result;
use crate::space::Code;
use crate::tree::Child;
use crate::value::{Rule, Value};

/// Receives the segments of a tree as they are finished, a node's before its ancestors'.
pub(super) trait SegmentSink<D: Layout, V: Value> {
    /// Takes one segment.
    fn segment(&mut self, segment: Sealed<D, V>) -> Result<()>;

    /// Takes one segment of another file as it is; the entry has the code it gets.
    fn copy(&mut self, segment: &Segment<'_, D, V>, entry: Entry<D, V>) -> Result<()>;
}

/// Merges parts whose siblings are complete and seals segments.
pub(super) struct Assembler<D: Layout, V: Value> {
    shape: Shape,
    rule: Rule,
    /// Cells along each axis that can be other than VOID.
    extent: [u64; 3],
    groups: HashMap<Code<D>, Group<D, V>>,
    root: Option<Part<D, V>>,
    pub(super) counts: LevelCounts,
}

/// The children of one node that are there already.
struct Group<D: Layout, V: Value> {
    parts: Vec<Option<Part<D, V>>>,
    missing: usize,
}

impl<D: Layout, V: Value> Assembler<D, V> {
    pub(super) fn new(shape: Shape, rule: Rule, extent: [u64; 3]) -> Self {
        Assembler { shape, rule, extent, groups: HashMap::new(), root: None, counts: LevelCounts::default() }
    }

    /// Whether a node has cells within the extent.
    pub(super) fn is_inside(&self, code: Code<D>) -> bool {
        let size = self.shape.depth - code.level();
        code.cell().iter().zip(self.extent).all(|(cell, extent)| (*cell as u64) << size < extent)
    }

    /// Takes a part whose own segment is already taken off; every node inside the extent must be covered once.
    pub(super) fn push(&mut self, part: Part<D, V>, sink: &mut impl SegmentSink<D, V>) -> Result<()> {
        let mut part = part;
        loop {
            let Some(parent) = part.code.parent() else {
                let state = match part.child {
                    Child::Void => [1, 0, 0],
                    Child::Leaf(_) => [0, 1, 0],
                    Child::Inner { .. } => [0, 0, 1],
                };
                self.counts.add(0, state);
                self.root = Some(part);
                return Ok(());
            };
            if !self.groups.contains_key(&parent) {
                let group = self.new_group(parent);
                self.groups.insert(parent, group);
            }
            let group = self.groups.get_mut(&parent).expect("just inserted");
            let place = part.code.step(parent.level());
            debug_assert!(group.parts[place].is_none(), "a node must not come twice");
            group.parts[place] = Some(part);
            group.missing -= 1;
            if group.missing > 0 {
                return Ok(());
            }
            let group = self.groups.remove(&parent).expect("it is there");
            let parts: Vec<_> = group.parts.into_iter().flatten().collect();
            part = Part::merge(parent, &parts, self.shape.depth, self.rule, &mut self.counts);
            if let Some(sealed) = part.seal(&self.shape) {
                sink.segment(sealed)?;
            }
        }
    }

    /// The children of a node, those outside the extent filled in.
    fn new_group(&self, parent: Code<D>) -> Group<D, V> {
        let outside = |i| {
            let child = parent.child(i);
            (!self.is_inside(child)).then(|| Part::uniform(child, self.shape.depth, None, false))
        };
        let parts: Vec<_> = (0..D::CHILDREN).map(outside).collect();
        let missing = parts.iter().filter(|part| part.is_none()).count();
        Group { parts, missing }
    }

    /// The root, once everything has come.
    pub(super) fn finish(self) -> Part<D, V> {
        self.root.expect("all blocks were pushed")
    }
}

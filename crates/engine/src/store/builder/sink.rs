//! Sinks, which write the parts of a tree to a file, and parts that wait for their siblings.

use std::collections::HashMap;

use super::encoded_subtree::{EncodedSubtree, SealedSegment};
use super::stored_node::{RecordRef, StoredNode};
use spinney_base::Result;
use spinney_base::space::{Code, Dimension};
use spinney_base::value::Value;
use spinney_container::LevelCounts;
use spinney_container::MAX_DENSE_LEVELS;

/// The part of a block, its own segment, and its numbers of nodes per level.
pub(in crate::store) type BuiltBlock = (EncodedSubtree, Option<SealedSegment>, LevelCounts);

/// Receives the parts of a tree, each once, and writes them to a file.
pub(in crate::store) trait TreeSink: Send {
    /// Receives a block, or a uniform node above the blocks.
    fn push(&mut self, built: BuiltBlock) -> Result<()>;

    /// Receives several, in order.
    fn push_all(&mut self, built: Vec<BuiltBlock>) -> Result<()> {
        built.into_iter().try_for_each(|built| self.push(built))
    }

    /// Returns the maximum number of levels of dense blocks in parts.
    fn dense_levels(&self) -> u8 {
        MAX_DENSE_LEVELS
    }

    /// Reuses the records that the file already has of a node; returns whether that was possible.
    fn keep(&mut self, _: Code, _: RecordRef) -> Result<bool> {
        Ok(false)
    }

    /// Returns whether [`TreeSink::copy`] can copy all stored data of an INNER node from another
    /// file.
    fn can_copy(&self, _: Code, _: &StoredNode<'_>) -> Result<bool> {
        Ok(false)
    }

    /// Copies all stored data of an INNER node from another file, segment by segment. Only called
    /// if [`TreeSink::can_copy`] returned `true`.
    fn copy(&mut self, _: Code, _: Value, _: &StoredNode<'_>) -> Result<()> {
        unreachable!("a sink that can copy implements `copy`")
    }
}

/// Parts that wait for their siblings.
pub(in crate::store) struct Siblings<P> {
    dimension: Dimension,
    depth: u8,
    /// Cells along each axis that may differ from VOID.
    extent: [u64; 3],
    groups: HashMap<Code, Group<P>>,
}

/// The children of one node that have arrived so far.
struct Group<P> {
    parts: Vec<Option<P>>,
    missing: usize,
}

impl<P> Siblings<P> {
    pub(in crate::store) fn new(dimension: Dimension, depth: u8, extent: [u64; 3]) -> Self {
        Siblings { dimension, depth, extent, groups: HashMap::new() }
    }

    /// Returns whether a node has cells within the extent.
    fn is_inside(&self, code: Code) -> bool {
        let size = self.depth - code.level();
        code.cell().iter().zip(self.extent).all(|(cell, extent)| (*cell as u64) << size < extent)
    }

    /// Adds a child of `parent`. If it was the last missing one, returns all children in order;
    /// `void` makes those outside of the extent.
    pub(in crate::store) fn join(
        &mut self,
        parent: Code,
        step: usize,
        part: P,
        void: impl Fn(Code) -> P,
    ) -> Option<Vec<P>> {
        if !self.groups.contains_key(&parent) {
            // Children outside of the extent are never pushed. They are made here, so that the
            // others complete the group.
            let outside = |i| {
                let child = parent.child(i);
                (!self.is_inside(child)).then(|| void(child))
            };
            let parts: Vec<_> = (0..self.dimension.children()).map(outside).collect();
            let missing = parts.iter().filter(|part| part.is_none()).count();
            self.groups.insert(parent, Group { parts, missing });
        }
        let group = self.groups.get_mut(&parent).expect("just inserted");
        // Invariant: each child is pushed once, unless it is outside of the extent. So a group is
        // complete, and is removed, when the missing number of children have arrived, in any order.
        // A group that is never completed would leave the tree without a root; a child pushed twice
        // would complete a group too early.
        debug_assert!(group.parts[step].is_none(), "a node is pushed once");
        group.parts[step] = Some(part);
        group.missing -= 1;
        if group.missing > 0 {
            return None;
        }
        let group = self.groups.remove(&parent).expect("it is there");
        Some(group.parts.into_iter().flatten().collect())
    }
}

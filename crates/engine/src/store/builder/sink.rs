//! Sinks, which make files of the parts of a tree, and the parts that wait for their siblings.

use std::collections::HashMap;

use super::part::{Part, SealedSegment};
use super::stored_node::{RecordRef, StoredNode};
use spinney_base::Result;
use spinney_base::space::{Code, Dimension};
use spinney_base::value::Value;
use spinney_container::LevelCounts;
use spinney_container::MAX_DENSE_LEVELS;

/// A block's part of the tree, its own segment, and its nodes per level.
pub(in crate::store) type BuiltBlock = (Part, Option<SealedSegment>, LevelCounts);

/// Takes the parts of a tree, each once, and makes a file of them.
pub(in crate::store) trait TreeSink: Send {
    /// Takes a block, or a uniform node above the blocks.
    fn push(&mut self, built: BuiltBlock) -> Result<()>;

    /// Takes several, one after the other.
    fn push_all(&mut self, built: Vec<BuiltBlock>) -> Result<()> {
        built.into_iter().try_for_each(|built| self.push(built))
    }

    /// Levels of the largest dense blocks that parts may have.
    fn dense_levels(&self) -> u8 {
        MAX_DENSE_LEVELS
    }

    /// Keeps what the file has already of a node; whether that could be done.
    fn keep(&mut self, _: Code, _: RecordRef) -> Result<bool> {
        Ok(false)
    }

    /// Whether all that another file has stored of an INNER node can be taken over by [`TreeSink::copy`].
    fn can_copy(&self, _: Code, _: &StoredNode<'_>) -> Result<bool> {
        Ok(false)
    }

    /// Takes over all that another file has stored of an INNER node, segment by segment. Only called where
    /// that can be done.
    fn copy(&mut self, _: Code, _: Value, _: &StoredNode<'_>) -> Result<()> {
        unreachable!("a sink that says that it can copy does")
    }
}

/// Parts that wait for their siblings.
pub(in crate::store) struct Siblings<P> {
    dimension: Dimension,
    depth: u8,
    /// Cells along each axis that can be other than VOID.
    extent: [u64; 3],
    groups: HashMap<Code, Group<P>>,
}

/// The children of one node that are there already.
struct Group<P> {
    parts: Vec<Option<P>>,
    missing: usize,
}

impl<P> Siblings<P> {
    pub(in crate::store) fn new(dimension: Dimension, depth: u8, extent: [u64; 3]) -> Self {
        Siblings { dimension, depth, extent, groups: HashMap::new() }
    }

    /// Whether a node has cells within the extent.
    fn is_inside(&self, code: Code) -> bool {
        let size = self.depth - code.level();
        code.cell().iter().zip(self.extent).all(|(cell, extent)| (*cell as u64) << size < extent)
    }

    /// Takes a child of `parent`; if it was the last that was missing, hands back all children in order,
    /// those outside the extent as `void` makes them.
    pub(in crate::store) fn join(
        &mut self,
        parent: Code,
        step: usize,
        part: P,
        void: impl Fn(Code) -> P,
    ) -> Option<Vec<P>> {
        if !self.groups.contains_key(&parent) {
            // Children outside the extent never come: they are made here, so that the others complete the
            // group.
            let outside = |i| {
                let child = parent.child(i);
                (!self.is_inside(child)).then(|| void(child))
            };
            let parts: Vec<_> = (0..self.dimension.children()).map(outside).collect();
            let missing = parts.iter().filter(|part| part.is_none()).count();
            self.groups.insert(parent, Group { parts, missing });
        }
        let group = self.groups.get_mut(&parent).expect("just inserted");
        // Invariant: each child comes once, unless it is outside of the extent. So a group is complete when
        // as many have come as were missing, in any order, and goes. A group that is never complete would
        // leave the tree without a root; a child that came twice would complete one that is not.
        debug_assert!(group.parts[step].is_none(), "a node must not come twice");
        group.parts[step] = Some(part);
        group.missing -= 1;
        if group.missing > 0 {
            return None;
        }
        let group = self.groups.remove(&parent).expect("it is there");
        Some(group.parts.into_iter().flatten().collect())
    }
}

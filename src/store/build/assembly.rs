//! What makes files of the parts of a tree.

use std::collections::HashMap;

use super::counts::LevelCounts;
use super::part::{Part, Sealed};
use crate::Result;
use crate::space::Code;
use crate::store::autumnal::Kept;
use crate::store::goblin::{Copied, Layout};
use crate::tree::{Child, Stored};
use crate::value::Value;

/// A block's part of the tree, its own segment, and its nodes per level.
pub(in crate::store) type Built<D, V> = (Part<D, V>, Option<Sealed<D, V>>, LevelCounts);

/// Takes the parts of a tree, each once, and makes a file of them.
pub(in crate::store) trait Assembly<D: Layout, V: Value>: Send {
    /// Takes a block, or a uniform node above the blocks.
    fn push(&mut self, built: Built<D, V>) -> Result<()>;

    /// Keeps what the file has already of a node; whether that could be done.
    fn keep(&mut self, _: Code<D>, _: Kept) -> Result<bool> {
        Ok(false)
    }

    /// What a Goblin file has stored of an INNER node, if all of it can be taken over by [`Assembly::copy`].
    fn copied<'s>(&self, _: Code<D>, _: V, _: Stored<'s, D, V>) -> Result<Option<Copied<'s, D, V>>> {
        Ok(None)
    }

    /// Takes that over.
    fn copy(&mut self, copied: Copied<'_, D, V>) -> Result<()>;
}

/// Parts that wait for their siblings.
pub(in crate::store) struct Siblings<D: Layout, P> {
    depth: u8,
    /// Cells along each axis that can be other than VOID.
    extent: [u64; 3],
    groups: HashMap<Code<D>, Group<P>>,
}

/// The children of one node that are there already.
struct Group<P> {
    parts: Vec<Option<P>>,
    missing: usize,
}

impl<D: Layout, P> Siblings<D, P> {
    pub(in crate::store) fn new(depth: u8, extent: [u64; 3]) -> Self {
        Siblings { depth, extent, groups: HashMap::new() }
    }

    /// Whether a node has cells within the extent.
    fn is_inside(&self, code: Code<D>) -> bool {
        let size = self.depth - code.level();
        code.cell().iter().zip(self.extent).all(|(cell, extent)| (*cell as u64) << size < extent)
    }

    /// Takes a child of `parent`; if it was the last that was missing, hands back all children in order, those outside the
    /// extent as `void` makes them.
    pub(in crate::store) fn join(
        &mut self,
        parent: Code<D>,
        step: usize,
        part: P,
        void: impl Fn(Code<D>) -> P,
    ) -> Option<Vec<P>> {
        if !self.groups.contains_key(&parent) {
            let outside = |i| {
                let child = parent.child(i);
                (!self.is_inside(child)).then(|| void(child))
            };
            let parts: Vec<_> = (0..D::CHILDREN).map(outside).collect();
            let missing = parts.iter().filter(|part| part.is_none()).count();
            self.groups.insert(parent, Group { parts, missing });
        }
        let group = self.groups.get_mut(&parent).expect("just inserted");
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

/// The state of a node as records have it: VOID, LEAF or INNER.
pub(in crate::store) fn state_of<V, N>(child: &Child<V, N>) -> u8 {
    match child {
        Child::Void => crate::store::goblin::VOID,
        Child::Leaf(_) => crate::store::goblin::LEAF,
        Child::Inner { .. } => crate::store::goblin::INNER,
    }
}

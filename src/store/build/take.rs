//! Takes over whole subtrees of records that files have stored, instead of going through them node by node.

use super::counts::LevelCounts;
use super::subtree::count_nodes;
use crate::Result;
use crate::store::goblin::Segment;
use crate::store::goblin::{Layout, Record};
use crate::tree::{Child, Stored};
use crate::value::Value;

/// A node whose records are taken over.
#[derive(Clone, Copy)]
pub(in crate::store) struct Splice {
    /// Its place in its level.
    pub(in crate::store) place: u32,
    /// Where its records are among all that were taken over.
    pub(in crate::store) start: u32,
    pub(in crate::store) len: u32,
}

/// Records that are taken over for one block.
pub(in crate::store) struct Taken<D: Layout, V: Value> {
    /// Levels of the block.
    height: u8,
    pub(in crate::store) records: Vec<D::Record<V>>,
    /// Nodes below what was taken; the block's root is at level 0.
    pub(in crate::store) counts: LevelCounts,
}

impl<D: Layout, V: Value> Taken<D, V> {
    pub(in crate::store) fn new(height: u8) -> Self {
        Taken { height, records: Vec::new(), counts: LevelCounts::default() }
    }

    /// Takes a subtree with so many levels that will be at `place` of its level; `None` if its records contradict each
    /// other: going through it the usual way tells what is wrong.
    pub(in crate::store) fn take(
        &mut self,
        place: usize,
        subtree: &[D::Record<V>],
        levels: u8,
    ) -> Option<Splice> {
        count_nodes::<D, V>(subtree, levels, self.height - levels, &mut self.counts).ok()?;
        let start = self.records.len() as u32;
        self.records.extend_from_slice(subtree);
        Some(Splice { place: place as u32, start, len: subtree.len() as u32 })
    }
}

/// The records of a file's node and of all that is below it in its segment.
pub(in crate::store) struct Subtree<'a, D: Layout, V: Value> {
    segment: Segment<'a, D, V>,
    at: usize,
}

impl<'a, D: Layout, V: Value> Subtree<'a, D, V> {
    pub(in crate::store) fn of(stored: &Stored<'a, D, V>) -> Result<Self> {
        let segment = stored.file.segment(stored.node.segment as usize)?;
        Ok(Subtree { segment, at: stored.node.record as usize })
    }

    /// That of an INNER node.
    pub(in crate::store) fn at(place: &Child<V, Stored<'a, D, V>>) -> Result<Option<Self>> {
        match place {
            Child::Inner { node, .. } => Subtree::of(node).map(Some),
            _ => Ok(None),
        }
    }

    /// None at all if the node's own record lies.
    pub(in crate::store) fn records(&self) -> &[D::Record<V>] {
        let (records, at) = (self.segment.records(), self.at);
        records.get(at..at + records[at].skip() as usize).unwrap_or(&[])
    }
}

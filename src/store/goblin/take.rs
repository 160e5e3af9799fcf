//! Takes whole subtrees from a source, instead of asking for them node by node: records that a file has stored, and small
//! blocks of cells that the source can draw.

use super::block::Block;
use super::counts::LevelCounts;
use super::record::{Layout, Record};
use super::subtree::each_record;
use crate::Result;
use crate::space::Code;
use crate::tree::{Child, Source, Stored};
use crate::value::Rule;

/// Cells of a block that is drawn, as a power of two: a quadtree's block of 32 x 32 cells, an octree's of 8 x 8 x 8. Larger
/// ones are drawn in vain where there is little detail.
const DRAWN_BITS: u8 = 10;

/// A node whose records are taken over.
#[derive(Clone, Copy)]
pub(super) struct Splice {
    /// Its place in its level.
    pub(super) place: u32,
    /// Where its records are among all that were taken over.
    pub(super) start: u32,
    pub(super) len: u32,
}

/// Takes subtrees over for one block.
pub(super) struct Taker<'s, S: Source<Dim: Layout>, F> {
    pub(super) source: &'s S,
    /// The node of a file that a source's node with so many levels below it is, if its records fit.
    pub(super) stored: F,
    pub(super) rule: Rule,
    /// Records of all that was taken.
    pub(super) records: Vec<<S::Dim as Layout>::Record<S::Value>>,
}

impl<'s, S, F> Taker<'s, S, F>
where
    S: Source<Dim: Layout>,
    F: Fn(&'s S, &S::Node, u8) -> Option<Stored<'s, S::Dim, S::Value>>,
{
    /// The whole of an INNER node that will be at `place` of its level and has so many levels below it, if it can be had
    /// in one go; uniform if it turns out to be.
    #[allow(clippy::type_complexity)] // a child and where its records are: a name would hide more than it says
    pub(super) fn take(
        &mut self,
        place: usize,
        node: &S::Node,
        representative: S::Value,
        levels: u8,
    ) -> Result<Option<(Child<S::Value, ()>, Splice)>> {
        let start = self.records.len();
        let child = if let Some(stored) = (self.stored)(self.source, node, levels) {
            let segment = stored.file.segment(stored.node.segment as usize)?;
            let at = stored.node.record as usize;
            let records = segment.records();
            let records = records.get(at..at + records[at].skip() as usize).unwrap_or(&[]);
            if each_record::<S::Dim, S::Value>(records, levels, |_, _| {}).is_err() {
                // Going through it the usual way tells what is wrong.
                return Ok(None);
            }
            self.records.extend_from_slice(records);
            Child::Inner { representative, node: () }
        } else {
            let is_small = levels == DRAWN_BITS / <S::Dim as crate::space::Dimension>::AXES as u8;
            let cells = if is_small { self.source.cells(node, levels)? } else { None };
            let Some(cells) = cells else { return Ok(None) };
            let block = Block::<S::Dim, _>::from_cells(Code::ROOT, levels, cells.present, cells.values);
            let part = block.build(self.rule, false, &mut LevelCounts::default());
            self.records.extend_from_slice(&part.records);
            part.child
        };
        let len = (self.records.len() - start) as u32;
        Ok(Some((child, Splice { place: place as u32, start: start as u32, len })))
    }
}

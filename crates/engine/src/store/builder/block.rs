//! The nodes of one block of cells, level by level in flat arrays in Z order, where the children of
//! a node are consecutive.
//!
//! Arrays store values as bytes, so that a block is the same type for all value types.

use super::level::Level;
use super::reused::{ReusedNode, ReusedRecords};
use crate::store::records::subtree::{RECORDS_ARE_CHECKED, each_leaf};
use crate::store::records::{Record, RecordLayout};
use crate::tree::Child;
use spinney_base::TreeType;
use spinney_base::space::Code;
use spinney_container::{INNER, LEAF, LevelCounts, VOID};

/// The nodes of a block, from its root down to its cells, or to the source's leaves.
pub(super) struct Block {
    pub(super) form: TreeType,
    pub(super) code: Code,
    /// Levels from the block's root to the cells.
    pub(super) height: u8,
    pub(super) levels: Vec<Level>,
    pub(super) reused: ReusedRecords,
    /// Number of nodes of each level below the root, which is at level 0; known once the block is
    /// reduced.
    pub(super) counts: LevelCounts,
}

impl Block {
    /// Returns a block of the levels that were gathered from a source.
    pub(super) fn new(
        form: TreeType,
        code: Code,
        height: u8,
        levels: Vec<Level>,
        reused: ReusedRecords,
    ) -> Self {
        Block { form, code, height, levels, reused, counts: LevelCounts::default() }
    }

    /// Returns the block under `code`, of `height` levels, from all its cells in Z order.
    pub(super) fn from_cells(
        form: TreeType,
        code: Code,
        height: u8,
        states: Vec<u8>,
        values: Vec<u8>,
    ) -> Self {
        debug_assert_eq!(states.len() as u64, form.dimension.cells(height));
        let mut levels: Vec<Level> =
            (0..height).map(|level| Level::new(form, form.dimension.cells(level) as usize)).collect();
        levels.push(Level { states, values, expanded: None, reused: Vec::new() });
        let reused = ReusedRecords::new(RecordLayout::new(form), height);
        Block { form, code, height, levels, reused, counts: LevelCounts::default() }
    }

    pub(super) fn form(&self) -> TreeType {
        self.form
    }

    /// Returns the block's root, once the block is reduced.
    pub(super) fn root(&self) -> Child<()> {
        let root = &self.levels[0];
        let value = root.value(self.form, 0);
        match root.states[0] {
            VOID => Child::Void,
            LEAF => Child::Leaf(value),
            _ => Child::Inner { representative: value, node: () },
        }
    }

    /// Returns the number of cells per node of the level `index` levels below the block's root.
    pub(super) fn cells_at(&self, index: usize) -> u32 {
        self.form.dimension.cells(self.height - index as u8) as u32
    }

    /// Returns the copied records of a node.
    pub(super) fn reused_records<R: Record>(&self, node: &ReusedNode) -> &[R] {
        R::of(self.reused.records(node))
    }
}

/// Passes the leaves that the block was made of, before condensing, to `leaf`, with their number of
/// cells.
#[inline]
pub(super) fn for_leaves<R: Record>(block: &Block, leaf: &mut impl FnMut(R::Bytes, u32)) {
    for (index, level) in block.levels.iter().enumerate() {
        let cells = block.cells_at(index);
        for node in &level.reused {
            let reused = block.reused_records::<R>(node);
            reused_leaves(reused, block.height - index as u8, leaf);
        }
        let values = level.values_of::<R>();
        let leaves = level.states.iter().zip(values);
        match &level.expanded {
            Some(expanded) => {
                let mut expanded = expanded.iter().peekable();
                for (index, (state, value)) in leaves.enumerate() {
                    if expanded.next_if_eq(&&(index as u32)).is_none() && *state == LEAF {
                        leaf(*value, cells);
                    }
                }
            }
            None if index + 1 < block.levels.len() => {}
            // The level of the cells.
            None => {
                for (state, value) in leaves {
                    if *state == LEAF {
                        leaf(*value, 1);
                    }
                }
            }
        }
    }
}

/// Passes the leaves of a reduced block's tree to `leaf`, level by level, with their number of
/// cells.
#[inline]
pub(super) fn for_nodes<R: Record>(block: &Block, leaf: &mut impl FnMut(R::Bytes, u32)) {
    let root = &block.levels[0];
    if root.states[0] == LEAF {
        leaf(root.values_of::<R>()[0], block.cells_at(0));
    }
    for (index, level) in block.levels.iter().enumerate() {
        let cells = block.cells_at(index);
        for node in &level.reused {
            let reused = block.reused_records::<R>(node);
            reused_leaves(reused, block.height - index as u8, leaf);
        }
        let Some(above) = index.checked_sub(1).map(|above| &block.levels[above]) else { continue };
        let values = level.values_of::<R>().chunks_exact(R::CHILDREN);
        for (group, (states, values)) in level.states.chunks_exact(R::CHILDREN).zip(values).enumerate() {
            // (Children of uniform parents no longer exist.)
            if above.states[above.parent(group)] == INNER {
                for (state, value) in states.iter().zip(values) {
                    if *state == LEAF {
                        leaf(*value, cells);
                    }
                }
            }
        }
    }
}

/// Passes the leaves of copied records to `leaf`. (Dynamic dispatch, because visitors are compiled
/// for very many types.)
fn reused_leaves<R: Record>(records: &[R], levels: u8, leaf: &mut dyn FnMut(R::Bytes, u32)) {
    each_leaf(records, levels, |value, cells| leaf(value, cells as u32)).expect(RECORDS_ARE_CHECKED);
}

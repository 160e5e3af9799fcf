//! A tile's part of the cells of a level, as a small octree of its own, with the true cells around it.

use std::sync::Arc;

use crate::Result;
use crate::query::cell_blocks::{Block, BlockState, Carry, CellBlocks};

/// The cells below one node.
pub(super) struct Part<'a> {
    pub(super) blocks: &'a mut dyn CellBlocks,
    /// Level of the node, and its place there.
    pub(super) level: u8,
    pub(super) node: [u32; 3],
}

impl CellBlocks for Part<'_> {
    fn level(&self) -> u8 {
        self.blocks.level() - self.level
    }

    fn carry(&self) -> Carry {
        self.blocks.carry()
    }

    fn state(&mut self, level: u8, node: [i64; 3]) -> Result<BlockState> {
        let node = std::array::from_fn(|axis| (i64::from(self.node[axis]) << level) + node[axis]);
        self.blocks.state(self.level + level, node)
    }

    fn block(&mut self, block: [i64; 3]) -> Result<Arc<Block>> {
        let level = self.block_level();
        self.blocks.block(std::array::from_fn(|axis| (i64::from(self.node[axis]) << level) + block[axis]))
    }

    fn ends(&self) -> [bool; 3] {
        self.node.map(|cell| cell + 1 == 1 << self.level)
    }
}

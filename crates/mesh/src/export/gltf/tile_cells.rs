//! A tile's cells as a small octree of its own, surrounded by the cells of the tree.

use std::sync::Arc;

use spinney_base::Result;
use spinney_engine::query::cell_blocks::{Block, BlockAttribute, BlockState, CellBlocks};

/// Cells below one node.
pub(super) struct TileCells<'a> {
    pub(super) blocks: &'a mut dyn CellBlocks,
    /// Level of the node, and its position at that level.
    pub(super) level: u8,
    pub(super) node: [u32; 3],
}

impl TileCells<'_> {
    /// Converts a node `level` levels below the tile to a node of the whole tree.
    fn whole(&self, level: u8, node: [i64; 3]) -> [i64; 3] {
        std::array::from_fn(|axis| (i64::from(self.node[axis]) << level) + node[axis])
    }
}

impl CellBlocks for TileCells<'_> {
    fn level(&self) -> u8 {
        self.blocks.level() - self.level
    }

    fn carry(&self) -> BlockAttribute {
        self.blocks.carry()
    }

    fn state(&mut self, level: u8, node: [i64; 3]) -> Result<BlockState> {
        let node = self.whole(level, node);
        self.blocks.state(self.level + level, node)
    }

    fn block(&mut self, block: [i64; 3]) -> Result<Arc<Block>> {
        let block = self.whole(self.block_level(), block);
        self.blocks.block(block)
    }

    fn ends(&self) -> [bool; 3] {
        self.node.map(|cell| cell + 1 == 1 << self.level)
    }
}

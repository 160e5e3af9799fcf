//! The sweep line's status: its edges in order, in blocks, so that insertion and removal move few
//! entries.

/// Maximum number of edges per block.
const MAX_BLOCK_EDGES: usize = 512;

/// A position in the list: the index of a block, and an index in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct StatusPosition {
    block: usize,
    index: usize,
}

/// Edge numbers in sweep-line order; no block is empty.
#[derive(Default)]
pub(super) struct Status {
    blocks: Vec<Vec<u32>>,
}

impl Status {
    // Invariant: no block is empty, since removing its last edge removes the block. So a search can
    // skip a block by its last edge, and the edge before a block's first one is the previous
    // block's last one. Otherwise, `before` would find no edge below a vertex, and the inside would
    // be taken for the outside.
    /// Returns the position of the first edge without a property that all edges before it have.
    pub(super) fn first_not(&self, has: impl Fn(u32) -> bool) -> StatusPosition {
        let block = self.blocks.partition_point(|block| block.last().is_some_and(|&edge| has(edge)));
        let index = self.blocks.get(block).map_or(0, |block| block.partition_point(|&edge| has(edge)));
        StatusPosition { block, index }
    }

    pub(super) fn get(&self, position: StatusPosition) -> Option<u32> {
        self.blocks.get(position.block)?.get(position.index).copied()
    }

    /// Returns the edge before a position.
    pub(super) fn before(&self, StatusPosition { block, index }: StatusPosition) -> Option<u32> {
        match (block, index) {
            (0, 0) => None,
            (block, 0) => self.blocks[block - 1].last().copied(),
            (block, index) => Some(self.blocks[block][index - 1]),
        }
    }

    /// Removes the edge at a position, and returns the position of the next one.
    pub(super) fn remove(&mut self, StatusPosition { block, index }: StatusPosition) -> StatusPosition {
        self.blocks[block].remove(index);
        if self.blocks[block].is_empty() {
            self.blocks.remove(block);
            StatusPosition { block, index: 0 }
        } else if index == self.blocks[block].len() {
            StatusPosition { block: block + 1, index: 0 }
        } else {
            StatusPosition { block, index }
        }
    }

    /// Inserts an edge before the one at a position, and returns its own position.
    pub(super) fn insert(&mut self, mut position: StatusPosition, edge: u32) -> StatusPosition {
        if position.block == self.blocks.len() {
            match self.blocks.last() {
                Some(last) => position = StatusPosition { block: position.block - 1, index: last.len() },
                None => self.blocks.push(Vec::new()),
            }
        }
        let block = &mut self.blocks[position.block];
        block.insert(position.index, edge);
        if block.len() > MAX_BLOCK_EDGES {
            let upper = block.split_off(MAX_BLOCK_EDGES / 2);
            if position.index >= MAX_BLOCK_EDGES / 2 {
                position =
                    StatusPosition { block: position.block + 1, index: position.index - MAX_BLOCK_EDGES / 2 };
                self.blocks.insert(position.block, upper);
            } else {
                self.blocks.insert(position.block + 1, upper);
            }
        }
        position
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_holds_across_blocks() {
        let mut status = Status::default();
        // Numbers in a fixed permutation, each inserted in order.
        let count = 5003;
        for i in 0..count {
            let edge = i * 1009 % count;
            let position = status.first_not(|other| other < edge);
            assert!(status.before(position).is_none_or(|before| before < edge));
            let position = status.insert(position, edge);
            assert_eq!(status.get(position), Some(edge));
        }
        assert!(status.blocks.len() > 5);
        assert!(status.blocks.concat().into_iter().eq(0..count));
        // Each position leads to the next one.
        let mut position = status.first_not(|other| other < 7);
        for edge in 7..count {
            assert_eq!(status.get(position), Some(edge));
            position = status.remove(position);
        }
        assert_eq!((status.get(position), status.before(position)), (None, Some(6)));
    }
}

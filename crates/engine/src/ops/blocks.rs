//! Blocks of computed cells with the nodes above these, for those who walk nodes: each block is computed once.

use std::sync::{Arc, Mutex, PoisonError};

use crate::tree::{Child, Children, NodeState};
use spinney_base::space::{Bounds, Code};
use spinney_base::value::Value;
use spinney_base::{Result, TreeType};

/// Levels below a block of a quadtree, and of an octree.
pub(super) const BLOCK_LEVELS: [u8; 2] = [8, 5];

/// A way to draw a box of nodes so many levels above the cells: values, and which of them there are.
pub(super) type DrawLevel<'a> = dyn FnMut(u8, &Bounds, &mut [u8], &mut [bool]) -> Result<()> + 'a;

/// Blocks that are kept.
const KEPT: usize = 16;

/// A block's nodes, level by level from the cells up.
pub(super) struct Block {
    levels: Vec<BlockLevel>,
    axes: usize,
    width: usize,
}

/// Nodes of a level, in rows.
struct BlockLevel {
    states: Vec<NodeState>,
    /// Values of LEAFs, and of all others what the level's own numbers make.
    values: Vec<u8>,
}

impl Block {
    /// The cells of a node with so many levels below it, and all between: cells decide what is uniform, the numbers of each level make
    /// representatives.
    pub(super) fn new(form: TreeType, (code, height): (Code, u8), draw: &mut DrawLevel<'_>) -> Result<Block> {
        let (axes, width) = (form.axes(), form.width());
        let mut block = Block { levels: Vec::with_capacity(usize::from(height)), axes, width };
        for above in 0..height {
            let cell = code.cell().map(|cell| u64::from(cell) << (height - above));
            let side = 1 << (height - above);
            let max = std::array::from_fn(|axis| if axis < axes { cell[axis] + side } else { 1 });
            let bounds =
                Bounds { min: std::array::from_fn(|axis| if axis < axes { cell[axis] } else { 0 }), max };
            let nodes = bounds.volume() as usize;
            let (mut values, mut valid) = (vec![0; nodes * width], vec![false; nodes]);
            draw(above, &bounds, &mut values, &mut valid)?;
            let state = |valid: &bool| if *valid { NodeState::Leaf } else { NodeState::Void };
            let mut level = BlockLevel { states: valid.iter().map(state).collect(), values };
            if let Some(below) = block.levels.last() {
                level.settle(below, (axes, width), side as usize);
            }
            block.levels.push(level);
        }
        Ok(block)
    }

    /// The children of a node of the block, so many levels above its cells, given by its place among the nodes of its level.
    fn children(&self, code: Code, above: u8, children: &mut Children<Code>) {
        let level = &self.levels[usize::from(above) - 1];
        let side = 1usize << (self.levels.len() - (usize::from(above) - 1));
        for (step, child) in children[..1 << self.axes].iter_mut().enumerate() {
            let code = code.child(step);
            let place = code.cell().map(|cell| cell as usize & (side - 1));
            let index = index(place, side, self.axes);
            let value = || Value::from_bytes(&level.values[index * self.width..(index + 1) * self.width]);
            *child = match level.states[index] {
                NodeState::Void => Child::Void,
                NodeState::Leaf => Child::Leaf(value()),
                NodeState::Inner => Child::Inner { representative: value(), node: code },
            };
        }
    }
}

fn index(place: [usize; 3], side: usize, axes: usize) -> usize {
    place[..axes].iter().rev().fold(0, |index, cell| index * side + cell)
}

impl BlockLevel {
    /// Sets the states of nodes, of which there are so many along each axis, by those of their children.
    fn settle(&mut self, below: &BlockLevel, (axes, width): (usize, usize), side: usize) {
        let steps: Vec<usize> = (0..1usize << axes)
            .map(|step| index([step & 1, step >> 1 & 1, step >> 2 & 1], 2 * side, axes))
            .collect();
        for node in 0..self.states.len() {
            let place = [node % side, node / side % side, node / side / side];
            let first = index(place.map(|cell| 2 * cell), 2 * side, axes);
            let value = |child: usize| &below.values[child * width..(child + 1) * width];
            let state = below.states[first];
            let is_uniform = state != NodeState::Inner
                && steps[1..].iter().all(|step| {
                    let other = first + step;
                    below.states[other] == state && (state == NodeState::Void || value(other) == value(first))
                });
            let was_void = self.states[node] == NodeState::Void;
            self.states[node] = if is_uniform { state } else { NodeState::Inner };
            let own = &mut self.values[node * width..(node + 1) * width];
            if is_uniform {
                own.copy_from_slice(value(first));
            } else if was_void {
                // (Something has to stand for it.)
                let present = steps.iter().find(|step| below.states[first + *step] != NodeState::Void);
                present.into_iter().for_each(|step| own.copy_from_slice(value(first + step)));
            }
        }
    }
}

/// Blocks that were used last.
#[derive(Default)]
pub(super) struct Blocks(Mutex<Vec<(Code, Arc<Block>)>>);

impl Blocks {
    /// The children of a node at or below the level of blocks, of a tree of so many levels, whose blocks are made in some way.
    ///
    /// # Errors
    /// If a block cannot be made.
    pub(super) fn children(
        &self,
        (depth, block_level): (u8, u8),
        node: Code,
        children: &mut Children<Code>,
        make: &dyn Fn(Code) -> Result<Block>,
    ) -> Result<()> {
        let code = node.ancestor(block_level);
        let block = match self.kept(code) {
            Some(block) => block,
            None => {
                // (Without the lock: others may go on, and at worst two compute the same.)
                let block = Arc::new(make(code)?);
                let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
                if kept.len() >= KEPT {
                    kept.remove(0);
                }
                kept.push((code, block.clone()));
                block
            }
        };
        block.children(node, depth - node.level(), children);
        Ok(())
    }

    /// A block, which becomes the last that was used.
    fn kept(&self, code: Code) -> Option<Arc<Block>> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let index = kept.iter().rposition(|(other, _)| *other == code)?;
        if index + 1 < kept.len() {
            let found = kept.remove(index);
            kept.push(found);
        }
        kept.last().map(|(_, block)| block.clone())
    }
}

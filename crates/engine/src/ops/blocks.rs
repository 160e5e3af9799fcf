//! Cache of computed blocks of cells with the nodes above these, for traversals by node: each block
//! is computed once.

use std::sync::{Arc, Mutex, PoisonError};

use crate::tree::{Child, Children, NodeState};
use spinney_base::space::{Bounds, Code, Dimension};
use spinney_base::value::Value;
use spinney_base::{Result, TreeType};

/// Returns the number of levels below a block.
pub(super) fn block_levels(dimension: Dimension) -> u8 {
    match dimension {
        Dimension::Quad => 8,
        Dimension::Oct => 5,
    }
}

/// Draws a box of nodes of the level that is the given number above the cells: values, and which of
/// them are valid.
pub(super) type DrawLevel<'a> = dyn FnMut(u8, &Bounds, &mut [u8], &mut [bool]) -> Result<()> + 'a;

/// Number of cached blocks.
const MAX_CACHED: usize = 16;

/// Nodes of a block, level by level from the cells up.
pub(super) struct Block {
    levels: Vec<BlockLevel>,
    axes: usize,
    width: usize,
}

/// Nodes of one level, in rows.
struct BlockLevel {
    states: Vec<NodeState>,
    /// Values of LEAFs. All other values are computed from the samples of this level.
    values: Vec<u8>,
}

impl Block {
    /// Draws the cells of a node with `height` levels below it, and all levels between. Cells
    /// decide which nodes are uniform; representatives are computed from the samples of each level.
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

    /// Writes the children of a node that is `above` levels above the cells. The node's code gives
    /// its position among the nodes of its level.
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
    /// Sets the states of the level's nodes, `side` along each axis, from those of their children.
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
                // (Node has data: its representative is the first child that is present.)
                let present = steps.iter().find(|step| below.states[first + *step] != NodeState::Void);
                present.into_iter().for_each(|step| own.copy_from_slice(value(first + step)));
            }
        }
    }
}

/// Most recently used blocks.
#[derive(Default)]
pub(super) struct Blocks(Mutex<Vec<(Code, Arc<Block>)>>);

impl Blocks {
    /// Writes the children of a node at or below the block level of a tree with `depth` levels.
    /// `make` computes missing blocks.
    ///
    /// # Errors
    /// If a block cannot be computed.
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
                // (Without the lock: other threads continue, and in the worst case two compute the
                // same block.)
                let block = Arc::new(make(code)?);
                let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
                if kept.len() >= MAX_CACHED {
                    kept.remove(0);
                }
                kept.push((code, block.clone()));
                block
            }
        };
        block.children(node, depth - node.level(), children);
        Ok(())
    }

    /// Cached block, which becomes the most recently used.
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

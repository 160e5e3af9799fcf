//! A solid as an octree source. A block whose cells are all inside or all outside becomes uniform;
//! other blocks are divided.

use std::sync::Arc;

use spinney_base::space::Dimension;
use spinney_base::value::{SampleType, Value, ValueType};
use spinney_base::{Progress, Result, TreeType};
use spinney_engine::store::builder::ReusableSource;
use spinney_engine::tree::{Child, Children, Source};

/// Value of a cell that is inside.
const FULL: u8 = 255;

/// Number of levels of the blocks whose cells are evaluated at once.
const BITS_LEVELS: u8 = 3;

/// Classification of a block's cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BlockState {
    /// All cells are outside.
    Void,
    /// All cells are inside.
    Full,
    /// The cells may differ.
    Mixed,
}

/// A cube of cells.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block {
    /// The first cell.
    first: [u32; 3],
    /// Number of cells along a side.
    pub(crate) width: u32,
}

impl Block {
    /// Returns the block's centre.
    pub(crate) fn centre(self) -> [f64; 3] {
        self.first.map(|first| f64::from(first) + f64::from(self.width) / 2.0)
    }

    /// Returns the maximum distance of the cells' centres from the block's centre, along an axis.
    pub(crate) fn reach(self) -> f64 {
        f64::from(self.width - 1) / 2.0
    }

    /// Returns the centre of a cell, given by its position in the block.
    pub(crate) fn cell(self, position: [u32; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| f64::from(self.first[axis] + position[axis]) + 0.5)
    }
}

/// Bits of a block of up to 8 x 8 x 8 cells, in Z order: whether each cell is inside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Bits([u64; 8]);

impl Bits {
    /// Evaluates all cells of a block with `width` cells along a side, by their positions.
    pub(crate) fn of(width: u32, is_inside: &mut dyn FnMut([u32; 3]) -> bool) -> Bits {
        // Spreads three bits of a coordinate, with two bits between each.
        const SPREAD: [usize; 8] = [0, 1, 8, 9, 64, 65, 72, 73];
        let mut bits = Bits::default();
        for z in 0..width {
            for y in 0..width {
                for x in 0..width {
                    let [at_x, at_y, at_z] = [x, y, z].map(|at| SPREAD[at as usize]);
                    let index = at_x | at_y << 1 | at_z << 2;
                    bits.0[index / 64] |= u64::from(is_inside([x, y, z])) << (index % 64);
                }
            }
        }
        bits
    }
}

/// A solid over a grid of cells. Its inputs are numbered, so that each block keeps only those that
/// are relevant in it.
pub(crate) trait Solid: Send + Sync {
    /// Number of inputs.
    fn input_count(&self) -> u32;

    /// Classifies a block by the inputs `near`. Appends those that are still undecided within the
    /// block to `still`.
    fn classify(&self, block: Block, near: &[u32], still: &mut Vec<u32>) -> BlockState;

    /// Evaluates the cells of a block of up to 8 x 8 x 8.
    fn cells(&self, block: Block, near: &[u32]) -> Bits;
}

/// A solid as the source of an octree.
pub(crate) struct SolidTree<'a> {
    pub(crate) solid: &'a dyn Solid,
    pub(crate) depth: u8,
    pub(crate) progress: &'a dyn Progress,
}

/// A node that may not be uniform.
#[derive(Clone)]
pub(crate) enum SolidNode {
    /// A block, and the inputs that are relevant in it.
    Block(Block, Arc<[u32]>),
    /// Cell bits in Z order, and their number of levels: two or one.
    Cells(u64, u8),
}

impl SolidTree<'_> {
    fn child(&self, block: Block, near: &Arc<[u32]>) -> Child<SolidNode> {
        let mut still = Vec::new();
        match self.solid.classify(block, near, &mut still) {
            BlockState::Void => Child::Void,
            BlockState::Full => Child::Leaf(Value::from([FULL])),
            // (If the tree has a single cell.)
            BlockState::Mixed if block.width == 1 => cells(self.solid.cells(block, near).0[0], 0),
            BlockState::Mixed => {
                let near = if still.len() == near.len() { near.clone() } else { still.into() };
                inner(SolidNode::Block(block, near))
            }
        }
    }
}

/// Returns an INNER node. The representative is a dummy: the store computes it from the children.
fn inner(node: SolidNode) -> Child<SolidNode> {
    Child::Inner { representative: Value::from([FULL]), node }
}

/// Returns a node for cell bits in Z order with a number of levels.
fn cells(bits: u64, levels: u8) -> Child<SolidNode> {
    let all = u64::MAX >> (64 - (1u32 << (3 * levels)));
    match bits & all {
        0 => Child::Void,
        bits if bits == all => Child::Leaf(Value::from([FULL])),
        bits => inner(SolidNode::Cells(bits, levels)),
    }
}

impl Source for SolidTree<'_> {
    type Node = SolidNode;

    fn form(&self) -> TreeType {
        TreeType::new(Dimension::Oct, ValueType::new(SampleType::U8, 1))
    }

    fn depth(&self) -> u8 {
        self.depth
    }

    fn root(&self) -> Result<Child<SolidNode>> {
        let near = (0..self.solid.input_count()).collect();
        Ok(self.child(Block { first: [0; 3], width: 1 << self.depth }, &near))
    }

    fn children(&self, node: &SolidNode, children: &mut Children<SolidNode>) -> Result<()> {
        let (block, near) = match node {
            SolidNode::Cells(bits, levels) => {
                let below = levels - 1;
                for (number, child) in (0..).zip(children) {
                    *child = cells(bits >> (number << (3 * below)), below);
                }
                return Ok(());
            }
            SolidNode::Block(block, near) => (*block, near),
        };
        let levels = block.width.ilog2() as u8;
        if levels <= BITS_LEVELS {
            let Bits(bits) = self.solid.cells(block, near);
            for (number, child) in (0..).zip(children) {
                // (With fewer than 3 levels, the first word contains all cells.)
                *child = match levels {
                    BITS_LEVELS => cells(bits[number], 2),
                    2 => cells(bits[0] >> (8 * number), 1),
                    _ => cells(bits[0] >> number, 0),
                };
            }
            return Ok(());
        }
        self.progress.check()?;
        let width = block.width / 2;
        for (number, child) in (0..).zip(children) {
            let first = [0, 1, 2].map(|axis| block.first[axis] + width * (number >> axis & 1));
            *child = self.child(Block { first, width }, near);
        }
        Ok(())
    }
}

impl ReusableSource for SolidTree<'_> {}

//! A solid as a source of an octree: blocks are settled where all of their cells are inside or outside, and divided elsewhere.

use std::sync::Arc;

use spinney_base::space::Dimension;
use spinney_base::value::{SampleType, Value, ValueType};
use spinney_base::{Progress, Result, TreeType};
use spinney_engine::store::builder::ReusableSource;
use spinney_engine::tree::{Child, Children, Source};

/// Value of a cell that is inside.
const FULL: u8 = 255;

/// Levels of the blocks whose cells are decided at once.
const BITS_LEVELS: u8 = 3;

/// Where the cells of a block lie, as far as it is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// All are outside.
    Void,
    /// All are inside.
    Full,
    /// Neither is sure.
    Mixed,
}

/// A cube of cells.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block {
    /// Its first cell.
    first: [u32; 3],
    /// Cells along a side.
    pub(crate) width: u32,
}

impl Block {
    /// Its centre.
    pub(crate) fn centre(self) -> [f64; 3] {
        self.first.map(|first| f64::from(first) + f64::from(self.width) / 2.0)
    }

    /// How far the centres of its cells are from its own, along an axis.
    pub(crate) fn reach(self) -> f64 {
        f64::from(self.width - 1) / 2.0
    }

    /// The centre of a cell by its place in the block.
    pub(crate) fn cell(self, place: [u32; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| f64::from(self.first[axis] + place[axis]) + 0.5)
    }
}

/// Which cells of a block of up to 8 x 8 x 8 are inside, in Z order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Bits([u64; 8]);

impl Bits {
    /// Asks for all cells of a block of so many along a side, by their places.
    pub(crate) fn of(width: u32, is_inside: &mut dyn FnMut([u32; 3]) -> bool) -> Bits {
        // Three bits of a coordinate, two further ones between each.
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

/// A solid over cells. Parts of what it is made of have numbers, so that blocks go on with those that matter in them.
pub(crate) trait Solid: Send + Sync {
    /// Number of its parts.
    fn parts(&self) -> u32;

    /// Where a block lies, of whose cells the parts `near` decide. Those that still do in it are added to `still`.
    fn place(&self, block: Block, near: &[u32], still: &mut Vec<u32>) -> Place;

    /// The cells of a block of up to 8 x 8 x 8.
    fn cells(&self, block: Block, near: &[u32]) -> Bits;
}

/// A solid as the source of an octree.
pub(crate) struct SolidTree<'a> {
    pub(crate) solid: &'a dyn Solid,
    pub(crate) depth: u8,
    pub(crate) progress: &'a dyn Progress,
}

/// A node of which it is not known that it is uniform.
#[derive(Clone)]
pub(crate) enum SolidNode {
    /// A block at a level, and the parts that matter in it.
    Block(Block, Arc<[u32]>),
    /// Cells in Z order, so many levels of them: two or one.
    Cells(u64, u8),
}

impl SolidTree<'_> {
    fn child(&self, block: Block, near: &Arc<[u32]>) -> Child<SolidNode> {
        let mut still = Vec::new();
        match self.solid.place(block, near, &mut still) {
            Place::Void => Child::Void,
            Place::Full => Child::Leaf(Value::from([FULL])),
            // (Of a tree that is one cell.)
            Place::Mixed if block.width == 1 => cells(self.solid.cells(block, near).0[0], 0),
            Place::Mixed => {
                let near = if still.len() == near.len() { near.clone() } else { still.into() };
                inner(SolidNode::Block(block, near))
            }
        }
    }
}

/// A node that is asked for its children. What stands for it is worked out by what stores the tree.
fn inner(node: SolidNode) -> Child<SolidNode> {
    Child::Inner { representative: Value::from([FULL]), node }
}

/// Cells in Z order: so many levels of them.
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
        let near = (0..self.solid.parts()).collect();
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
                // (Of fewer levels, the first word has all cells.)
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

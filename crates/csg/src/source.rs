//! A CSG solid as an octree source. Each block keeps the primitives whose surfaces may pass through
//! it, and its children select from these.

use std::sync::Arc;

use crate::box_state::BoxState;
use crate::expression::{Instruction, Pruner};
use crate::field::{Bits, Field, SAMPLES};
use spinney_base::space::Dimension;
use spinney_base::value::{SampleType, Value, ValueType};
use spinney_base::{Progress, Result, TreeType};
use spinney_engine::store::builder::ReusableSource;
use spinney_engine::tree::{Child, Children, Source};

/// Value of a full cell.
const FULL: u8 = 255;

/// A solid over a grid of cells.
pub(crate) struct CsgTree<'a> {
    pub(crate) field: Field,
    pub(crate) instructions: Vec<Instruction>,
    pub(crate) depth: u8,
    /// Whether a cell at the surface stores the share of its samples that are inside, rather than
    /// being full or VOID.
    pub(crate) by_area: bool,
    pub(crate) progress: &'a dyn Progress,
}

/// A node that the surface may pass through.
#[derive(Clone)]
pub(crate) enum CsgNode {
    /// A block, with the simplified expression that is valid there.
    Block(Arc<Block>),
    /// Cell bits in Z order, and their number of levels: two or one.
    Cells(u64, u8),
}

/// A block of cells.
pub(crate) struct Block {
    level: u8,
    /// Position among the blocks of its level.
    position: [u32; 3],
    instructions: Vec<Instruction>,
}

impl CsgTree<'_> {
    /// Distance between samples, in cells. The outermost samples are half of it from a block's
    /// sides.
    fn spacing(&self) -> f64 {
        if self.by_area { 1.0 / f64::from(SAMPLES) } else { 1.0 }
    }

    /// Returns the first cell of a block, and the number of cells along a side.
    fn cells(&self, block: &Block) -> ([f64; 3], f64) {
        let width = f64::from(1u32 << (self.depth - block.level));
        (block.position.map(|position| f64::from(position) * width), width)
    }

    /// Returns a block as a child: VOID, LEAF or INNER.
    fn child(
        &self,
        level: u8,
        position: [u32; 3],
        instructions: &[Instruction],
        pruner: &mut Pruner,
    ) -> Child<CsgNode> {
        let mut block = Block { level, position, instructions: Vec::new() };
        let (first, width) = self.cells(&block);
        let half = width / 2.0;
        // (Only the box of the samples is classified. A surface in the margin around it separates
        // no samples.)
        let reach = half - self.spacing() / 2.0;
        match self.field.prune(pruner, instructions, first.map(|first| first + half), reach) {
            BoxState::Void => Child::Void,
            BoxState::Full => Child::Leaf(Value::from([FULL])),
            BoxState::Mixed if level == self.depth && self.by_area => {
                let bits = self.samples(&Block { instructions: pruner.instructions.clone(), ..block });
                let inside: u32 = bits.iter().map(|word| word.count_ones()).sum();
                let all = SAMPLES.pow(3);
                let value = (inside * u32::from(FULL) + all / 2) / all;
                Child::uniform((value > 0).then(|| Value::from([value as u8])))
            }
            // (A single cell is decided by its centre.)
            BoxState::Mixed if level == self.depth => {
                let centre = first.map(|first| first + 0.5);
                uniform(self.field.has(&pruner.instructions, centre))
            }
            BoxState::Mixed => {
                block.instructions.clone_from(&pruner.instructions);
                inner(CsgNode::Block(Arc::new(block)))
            }
        }
    }

    /// Tests the samples of a block.
    fn samples(&self, block: &Block) -> Bits {
        let spacing = self.spacing();
        let first = self.cells(block).0.map(|first| first + spacing / 2.0);
        self.field.samples(&block.instructions, first, spacing)
    }
}

/// Returns a cell or a uniform node.
fn uniform(is_full: bool) -> Child<CsgNode> {
    Child::uniform(is_full.then(|| Value::from([FULL])))
}

/// Returns an INNER node. The representative is a dummy: the store computes it from the children.
fn inner(node: CsgNode) -> Child<CsgNode> {
    Child::Inner { representative: Value::from([FULL]), node }
}

/// Returns a node for cell bits in Z order with a number of levels.
fn cells(bits: u64, levels: u8) -> Child<CsgNode> {
    let all = u64::MAX >> (64 - (1u32 << (3 * levels)));
    match bits & all {
        0 => uniform(false),
        bits if bits == all => uniform(true),
        bits => inner(CsgNode::Cells(bits, levels)),
    }
}

impl Source for CsgTree<'_> {
    type Node = CsgNode;

    fn form(&self) -> TreeType {
        TreeType::new(Dimension::Oct, ValueType::new(SampleType::U8, 1))
    }

    fn depth(&self) -> u8 {
        self.depth
    }

    fn root(&self) -> Result<Child<CsgNode>> {
        Ok(self.child(0, [0; 3], &self.instructions, &mut Pruner::default()))
    }

    fn children(&self, node: &CsgNode, children: &mut Children<CsgNode>) -> Result<()> {
        let block = match node {
            CsgNode::Cells(bits, levels) => {
                let below = levels - 1;
                for (number, child) in (0..).zip(children) {
                    *child = cells(bits >> (number << (3 * below)), below);
                }
                return Ok(());
            }
            CsgNode::Block(block) => block,
        };
        let levels = self.depth - block.level;
        if !self.by_area && levels <= SAMPLES.ilog2() as u8 {
            let bits = self.samples(block);
            for (number, child) in (0..).zip(children) {
                // (With fewer than 3 levels, the first word contains all cells.)
                *child = match levels {
                    3 => cells(bits[number], 2),
                    2 => cells(bits[0] >> (8 * number), 1),
                    _ => cells(bits[0] >> number, 0),
                };
            }
            return Ok(());
        }
        self.progress.check()?;
        let mut pruner = Pruner::default();
        for (number, child) in (0..).zip(children) {
            let position = [0, 1, 2].map(|axis| 2 * block.position[axis] + (number >> axis & 1));
            *child = self.child(block.level + 1, position, &block.instructions, &mut pruner);
        }
        Ok(())
    }
}

impl ReusableSource for CsgTree<'_> {}

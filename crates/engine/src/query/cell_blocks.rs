//! The cells of a level as blocks of bits, independent of the tree and its values: for operations
//! on the shape of a solid.

use std::collections::HashMap;
use std::ops::Deref;
use std::sync::Arc;

use super::check_level;
use super::occupancy::{Filling, HALF, check_octree};
use crate::tree::{CellBlock, Child, Children, Source, no_children};
use spinney_base::space::{Code, Dimension};
use spinney_base::value::{Rule, SampleType, Value, ValueType};
use spinney_base::{Error, Result};

/// Number of cells along an edge of a block.
pub const SIDE: u32 = 32;
/// Levels between a block and its cells.
const LEVELS: u8 = 5;
/// Number of rows of a block.
const ROWS: usize = (SIDE * SIDE) as usize;

/// Attribute of each cell of a block, in addition to whether it is solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockAttribute {
    /// No attribute.
    Nothing,
    /// Occupancy of the cell, 0 to 255. In trees of other rules than [`Rule::Occupancy`] it is 0 or
    /// 255.
    Coverage,
    /// The cell's value: see [`can_be_block_attribute`].
    Value,
}

/// Returns whether values of a type can be the attribute: one channel of `u8` or `u16` as that
/// number; three or four channels of `u8` as `red << 16 | green << 8 | blue`.
pub fn can_be_block_attribute(value: ValueType) -> bool {
    matches!((value.sample, value.channels), (SampleType::U8 | SampleType::U16, 1) | (SampleType::U8, 3 | 4))
}

/// State of a node at or above the level of the blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockState {
    /// All cells below are solid, or none is.
    Uniform(bool),
    /// Mixed cells below.
    Mixed,
}

/// The cells of a block.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// Solid cells: bit x of row `z * SIDE + y`.
    pub solid: Box<[u32]>,
    /// Attribute of the cells.
    pub carried: BlockAttributeValues,
}

/// Attribute values of a block's cells.
#[derive(Clone, Debug, PartialEq)]
pub enum BlockAttributeValues {
    /// One value for all cells.
    Same(u32),
    /// One value per cell for [`BlockAttribute::Coverage`]: x fastest, then y, then z.
    Coverage(Box<[u8]>),
    /// One value per cell for [`BlockAttribute::Value`], in the same order.
    Values(Box<[u32]>),
}

impl Block {
    fn uniform(solid: bool, attribute: u32) -> Block {
        let rows = vec![if solid { u32::MAX } else { 0 }; ROWS];
        Block { solid: rows.into(), carried: BlockAttributeValues::Same(attribute) }
    }

    /// Returns whether a cell is solid. Coordinates are relative to the block.
    #[inline]
    pub fn is_solid(&self, [x, y, z]: [u32; 3]) -> bool {
        self.solid[(z * SIDE + y) as usize] >> x & 1 > 0
    }

    /// Returns the attribute of a cell.
    #[inline]
    pub fn attribute(&self, [x, y, z]: [u32; 3]) -> u32 {
        match &self.carried {
            BlockAttributeValues::Same(attribute) => *attribute,
            BlockAttributeValues::Coverage(coverage) => coverage[((z * SIDE + y) * SIDE + x) as usize].into(),
            BlockAttributeValues::Values(values) => values[((z * SIDE + y) * SIDE + x) as usize],
        }
    }

    fn bytes(&self) -> usize {
        let carried = match &self.carried {
            BlockAttributeValues::Same(_) => 0,
            BlockAttributeValues::Coverage(coverage) => coverage.len(),
            BlockAttributeValues::Values(values) => values.len() * 4,
        };
        ROWS * 4 + carried
    }
}

/// The cells of one level of an octree, in blocks that can be read in any order.
pub trait CellBlocks {
    /// Returns the level of the cells: the octree's space has `2^level` of them along each axis.
    fn level(&self) -> u8;

    /// Returns the attribute of the cells.
    fn carry(&self) -> BlockAttribute;

    /// Returns the level of the blocks, which have [`SIDE`] cells along each axis, or all there
    /// are.
    fn block_level(&self) -> u8 {
        self.level().saturating_sub(LEVELS)
    }

    /// Returns the state of a node at or above the level of the blocks. Everything outside of the
    /// space is empty.
    ///
    /// # Errors
    /// If the tree is corrupt there.
    fn state(&mut self, level: u8, node: [i64; 3]) -> Result<BlockState>;

    /// Returns the cells of a block. Everything outside of the space is empty.
    ///
    /// # Errors
    /// If the tree is corrupt there.
    fn block(&mut self, block: [i64; 3]) -> Result<Arc<Block>>;

    /// Returns along which axes all cells after the last blocks are empty.
    fn ends(&self) -> [bool; 3] {
        [true; 3]
    }

    /// Checks that the underlying file has not changed: see [`Source::check_unchanged`].
    ///
    /// # Errors
    /// If it has.
    fn check_unchanged(&self) -> Result<()> {
        Ok(())
    }
}

/// Node type of the source that a pointer refers to.
type Node<P> = <<P as Deref>::Target as Source>::Node;

/// Blocks of a source, given by any kind of pointer.
pub struct SourceBlocks<P: Deref<Target: Source>> {
    source: P,
    cells: Cells,
    level: u8,
    /// Children of nodes above the blocks.
    nodes: HashMap<Code, Children<Node<P>>>,
    /// Cache of blocks in two generations: those used since the last change of generation, and
    /// those before them.
    blocks: [HashMap<[i64; 3], Arc<Block>>; 2],
    /// Size of the younger generation in bytes.
    held: usize,
    empty: Arc<Block>,
}

/// Maximum number of nodes above the blocks whose children are cached.
const MAX_NODES: usize = 1 << 13;
/// Maximum size of each generation of the block cache in bytes.
const MAX_HELD: usize = 32 << 20;

impl<P: Deref<Target: Source>> SourceBlocks<P> {
    /// Creates blocks from the cells of a source's level. By [`Rule::Occupancy`] a cell is solid if
    /// it is at least half full (128 of 255); by other rules if it is not VOID. INNER nodes of the
    /// level count by their representatives.
    ///
    /// # Errors
    /// If the source is a quadtree or has no such level, or if values cannot be the attribute.
    pub fn new(source: P, level: u8, rule: Rule, carry: BlockAttribute) -> Result<SourceBlocks<P>> {
        let form = source.form();
        check_octree(form)?;
        check_level(level, source.depth())?;
        if carry == BlockAttribute::Value && !can_be_block_attribute(form.value) {
            let expected = "1 channel of u8 or u16, or 3 or 4 channels of u8";
            return Err(Error::invalid("values of blocks", form.value.to_string(), expected));
        }
        Ok(SourceBlocks {
            source,
            cells: Cells { value_type: form.value, filling: Filling::of(rule, form.value), carry },
            level,
            nodes: HashMap::new(),
            blocks: Default::default(),
            held: 0,
            empty: Arc::new(Block::uniform(false, 0)),
        })
    }

    /// Returns a node, or the uniform block that contains it.
    fn find(&mut self, code: Code) -> Result<Child<Node<P>>> {
        let Some(parent) = code.parent() else { return self.source.root() };
        let step = code.step(parent.level());
        if let Some(children) = self.nodes.get(&parent) {
            return Ok(children[step].clone());
        }
        let node = match self.find(parent)? {
            Child::Inner { node, .. } => node,
            uniform => return Ok(uniform),
        };
        let mut children = no_children();
        self.source.children(&node, &mut children)?;
        let child = children[step].clone();
        if self.nodes.len() >= MAX_NODES {
            self.nodes.clear();
        }
        self.nodes.insert(parent, children);
        Ok(child)
    }

    fn read(&mut self, code: Code) -> Result<Arc<Block>> {
        let node = self.find(code)?;
        let height = self.level - code.level();
        if height == LEVELS && !node.is_inner() {
            let (solid, attribute) = self.cells.cell(node.value());
            return Ok(if !solid && attribute == 0 {
                self.empty.clone()
            } else {
                Arc::new(Block::uniform(solid, attribute))
            });
        }
        let carried = match self.cells.carry {
            BlockAttribute::Nothing => BlockAttributeValues::Same(0),
            BlockAttribute::Coverage => BlockAttributeValues::Coverage(vec![0; ROWS * SIDE as usize].into()),
            BlockAttribute::Value => BlockAttributeValues::Values(vec![0; ROWS * SIDE as usize].into()),
        };
        let mut block = Block { solid: vec![0; ROWS].into(), carried };
        self.fill(&node, height, [0; 3], &mut block)?;
        Ok(Arc::new(block))
    }

    /// Fills the cells of a block that a node `height` levels above the cells covers.
    fn fill(&self, node: &Child<Node<P>>, height: u8, at: [u32; 3], block: &mut Block) -> Result<()> {
        let node = match node {
            Child::Inner { node, .. } if height > 0 => node,
            _ => {
                self.cells.paint(node.value(), 1 << height, at, block);
                return Ok(());
            }
        };
        if self.level == self.source.depth()
            && let Some(cells) = self.source.cells(node, height)?
        {
            self.cells.copy(&cells, height, at, block);
            return Ok(());
        }
        let mut children = no_children();
        self.source.children(node, &mut children)?;
        for (step, child) in children.iter().enumerate() {
            let half = 1 << (height - 1);
            let at = std::array::from_fn(|axis| at[axis] + (step as u32 >> axis & 1) * half);
            self.fill(child, height - 1, at, block)?;
        }
        Ok(())
    }
}

impl<P: Deref<Target: Source>> CellBlocks for SourceBlocks<P> {
    fn check_unchanged(&self) -> Result<()> {
        self.source.check_unchanged()
    }

    fn carry(&self) -> BlockAttribute {
        self.cells.carry
    }

    fn level(&self) -> u8 {
        self.level
    }

    fn state(&mut self, level: u8, node: [i64; 3]) -> Result<BlockState> {
        let Some(code) = code_of(level, node) else { return Ok(BlockState::Uniform(false)) };
        let node = self.find(code)?;
        if node.is_inner() && level < self.level {
            return Ok(BlockState::Mixed);
        }
        Ok(BlockState::Uniform(self.cells.cell(node.value()).0))
    }

    fn block(&mut self, block: [i64; 3]) -> Result<Arc<Block>> {
        let Some(code) = code_of(self.block_level(), block) else { return Ok(self.empty.clone()) };
        if let Some(found) = self.blocks[0].get(&block) {
            return Ok(found.clone());
        }
        // Blocks that are used again move to the younger generation. When that is full, the older
        // one is dropped as a whole. This approximates LRU without an ordered list.
        let found = match self.blocks[1].remove(&block) {
            Some(found) => found,
            None => self.read(code)?,
        };
        self.held += found.bytes();
        if self.held > MAX_HELD {
            self.blocks[1] = std::mem::take(&mut self.blocks[0]);
            self.held = found.bytes();
        }
        self.blocks[0].insert(block, found.clone());
        Ok(found)
    }
}

/// Returns the node's code if it is in the space.
fn code_of(level: u8, node: [i64; 3]) -> Option<Code> {
    let [Ok(x), Ok(y), Ok(z)] = node.map(u32::try_from) else { return None };
    Code::from_cell(Dimension::Oct, level, [x, y, z])
}

/// Converts values to cells of blocks.
#[derive(Clone, Copy)]
struct Cells {
    value_type: ValueType,
    filling: Filling,
    carry: BlockAttribute,
}

impl Cells {
    /// Returns whether a cell is solid, and its attribute.
    #[inline]
    fn cell(self, value: Option<Value>) -> (bool, u32) {
        let fill = self.filling.fill(value);
        let attribute = match (self.carry, value) {
            (BlockAttribute::Nothing, _) | (_, None) => 0,
            (BlockAttribute::Coverage, _) => fill.into(),
            (BlockAttribute::Value, Some(value)) => self.number(value),
        };
        (fill >= HALF, attribute)
    }

    /// Returns a value as one number: see [`can_be_block_attribute`].
    #[inline]
    fn number(self, value: Value) -> u32 {
        let [a, b, c, ..] = value.to_bytes();
        match (self.value_type.sample, self.value_type.channels) {
            (SampleType::U16, _) => u16::from_le_bytes([a, b]).into(),
            (_, 1) => a.into(),
            _ => u32::from_be_bytes([0, a, b, c]),
        }
    }

    /// Writes a cube of cells of one value.
    fn paint(self, value: Option<Value>, side: u32, at: [u32; 3], block: &mut Block) {
        let (solid, attribute) = self.cell(value);
        if solid {
            let bits = (u32::MAX >> (SIDE - side)) << at[0];
            for z in at[2]..at[2] + side {
                let row = (z * SIDE + at[1]) as usize;
                block.solid[row..row + side as usize].iter_mut().for_each(|row| *row |= bits);
            }
        }
        if attribute == 0 {
            return;
        }
        for z in at[2]..at[2] + side {
            for y in at[1]..at[1] + side {
                let start = ((z * SIDE + y) * SIDE + at[0]) as usize;
                let row = start..start + side as usize;
                match &mut block.carried {
                    BlockAttributeValues::Same(_) => {}
                    BlockAttributeValues::Coverage(coverage) => coverage[row].fill(attribute as u8),
                    BlockAttributeValues::Values(values) => values[row].fill(attribute),
                }
            }
        }
    }

    /// Writes cells in row order.
    fn copy(self, cells: &CellBlock, height: u8, at: [u32; 3], block: &mut Block) {
        let values = cells.values.chunks_exact(self.value_type.size());
        let mask = (1 << height) - 1;
        for ((index, present), value) in (0u32..).zip(&cells.present).zip(values) {
            if *present {
                let cell = [index & mask, index >> height & mask, index >> (2 * height)];
                let at = std::array::from_fn(|axis| at[axis] + cell[axis]);
                self.paint(Some(Value::from_bytes(value)), 1, at, block);
            }
        }
    }
}

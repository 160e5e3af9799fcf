//! The cells of a level in blocks of bits, whatever the tree and its values: what work on the shape of a solid needs.

use std::collections::HashMap;
use std::sync::Arc;

use super::occupancy::{Filling, HALF};
use crate::space::{Code, Oct};
use crate::tree::{CellBlock, Child, Source};
use crate::value::{Rule, Sample, SampleType, Value, ValueType};
use crate::{Error, Result};

/// Cells along an edge of a block.
pub const SIDE: u32 = 32;
/// Levels between a block and its cells.
const LEVELS: u8 = 5;
/// Rows of a block.
const ROWS: usize = (SIDE * SIDE) as usize;

/// What is told of a cell besides whether it is solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carry {
    /// Nothing.
    Nothing,
    /// How full it is, 0 to 255; that of trees with other rules than [`Rule::Occupancy`] is 0 or 255.
    Coverage,
    /// Its value: see [`can_carry_value`].
    Value,
}

/// Whether values of a type can be carried: one channel of u8 or u16 as that number; three or four of u8 as
/// `red << 16 | green << 8 | blue`.
pub fn can_carry_value(value: ValueType) -> bool {
    matches!((value.sample, value.channels), (SampleType::U8 | SampleType::U16, 1) | (SampleType::U8, 3 | 4))
}

/// A node of a level down to that of the blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// All cells below are solid, or none is.
    Uniform(bool),
    /// More detail below.
    Mixed,
}

/// The cells of a block.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// Which cells are solid: bit x of row `z * SIDE + y`.
    pub solid: Box<[u32]>,
    /// What is carried of them.
    pub told: Told,
}

/// What is carried of the cells of a block.
#[derive(Clone, Debug, PartialEq)]
pub enum Told {
    /// The same of all.
    Same(u32),
    /// Something of each: x runs fastest, then y, then z.
    Each(Box<[u32]>),
}

impl Block {
    fn uniform(solid: bool, told: u32) -> Block {
        Block { solid: vec![if solid { u32::MAX } else { 0 }; ROWS].into(), told: Told::Same(told) }
    }

    /// Whether a cell, in cells of the block, is solid.
    #[inline]
    pub fn is_solid(&self, [x, y, z]: [u32; 3]) -> bool {
        self.solid[(z * SIDE + y) as usize] >> x & 1 > 0
    }

    /// What is carried of a cell.
    #[inline]
    pub fn told(&self, [x, y, z]: [u32; 3]) -> u32 {
        match &self.told {
            Told::Same(told) => *told,
            Told::Each(told) => told[((z * SIDE + y) * SIDE + x) as usize],
        }
    }

    fn bytes(&self) -> usize {
        let told = if let Told::Each(told) = &self.told { told.len() * 4 } else { 0 };
        ROWS * 4 + told
    }
}

/// An octree's cells of one level, in blocks that can be asked for in any order.
pub trait CellBlocks {
    /// The level of the cells: the octree's space has `2^level` of them along each axis.
    fn level(&self) -> u8;

    /// What is told of each cell.
    fn carry(&self) -> Carry;

    /// The level of the blocks: [`SIDE`] cells along each axis, or all there are.
    fn block_level(&self) -> u8 {
        self.level().saturating_sub(LEVELS)
    }

    /// What a node of a level, down to that of the blocks, looks like; all outside the space is empty.
    ///
    /// # Errors
    /// If the tree is damaged there.
    fn state(&mut self, level: u8, node: [i64; 3]) -> Result<State>;

    /// The cells of a block; all outside the space are empty.
    ///
    /// # Errors
    /// If the tree is damaged there.
    fn block(&mut self, block: [i64; 3]) -> Result<Arc<Block>>;
}

/// Blocks of a source.
pub struct SourceBlocks<S: Source<Dim = Oct>> {
    source: S,
    cells: Cells,
    level: u8,
    /// Children of nodes above the blocks.
    nodes: HashMap<Code<Oct>, Children<S>>,
    /// Blocks used lately, and those before them.
    blocks: [HashMap<[i64; 3], Arc<Block>>; 2],
    /// Bytes of the former.
    held: usize,
    empty: Arc<Block>,
}

type Place<S> = Child<<S as Source>::Value, <S as Source>::Node>;
type Children<S> = [Place<S>; 8];

/// Nodes above the blocks that are remembered.
const NODES: usize = 1 << 13;
/// Bytes of blocks that are remembered, twice.
const HELD: usize = 32 << 20;

impl<S: Source<Dim = Oct>> SourceBlocks<S> {
    /// The cells of a level of a source. By [`Rule::Occupancy`] a cell is solid if it is at least half full (128 of
    /// 255); by other rules if it is not VOID. INNER nodes of the level are what their representatives say.
    ///
    /// # Errors
    /// If the source has no such level, or if values cannot be carried.
    pub fn new(source: S, level: u8, rule: Rule, carry: Carry) -> Result<SourceBlocks<S>> {
        if level > source.depth() {
            return Err(Error::invalid("level", level.to_string(), format!("0 to {}", source.depth())));
        }
        if carry == Carry::Value && !can_carry_value(S::Value::TYPE) {
            let expected = "u8, u16, or three or four channels of u8";
            return Err(Error::invalid("values to carry", S::Value::TYPE.to_string(), expected));
        }
        Ok(SourceBlocks {
            source,
            cells: Cells { filling: Filling::of::<S::Value>(rule), carry },
            level,
            nodes: HashMap::new(),
            blocks: Default::default(),
            held: 0,
            empty: Arc::new(Block::uniform(false, 0)),
        })
    }

    /// What stands at a node's place.
    fn place(&mut self, code: Code<Oct>) -> Result<Place<S>> {
        let Some(parent) = code.parent() else { return self.source.root() };
        let step = code.step(parent.level());
        if let Some(children) = self.nodes.get(&parent) {
            return Ok(children.as_ref()[step].clone());
        }
        let node = match self.place(parent)? {
            Child::Inner { node, .. } => node,
            uniform => return Ok(uniform),
        };
        let children = self.source.children(&node)?;
        let child = children.as_ref()[step].clone();
        if self.nodes.len() >= NODES {
            self.nodes.clear();
        }
        self.nodes.insert(parent, children);
        Ok(child)
    }

    fn read(&mut self, code: Code<Oct>) -> Result<Arc<Block>> {
        let place = self.place(code)?;
        let height = self.level - code.level();
        if height == LEVELS && !place.is_inner() {
            let (solid, told) = self.cells.cell(place.value());
            return Ok(if !solid && told == 0 {
                self.empty.clone()
            } else {
                Arc::new(Block::uniform(solid, told))
            });
        }
        let told = match self.cells.carry {
            Carry::Nothing => Told::Same(0),
            _ => Told::Each(vec![0; ROWS * SIDE as usize].into()),
        };
        let mut block = Block { solid: vec![0; ROWS].into(), told };
        self.fill(&place, height, [0; 3], &mut block)?;
        Ok(Arc::new(block))
    }

    /// Fills the part of a block that a node `height` levels above the cells covers.
    fn fill(&self, place: &Place<S>, height: u8, at: [u32; 3], block: &mut Block) -> Result<()> {
        let node = match place {
            Child::Inner { node, .. } if height > 0 => node,
            _ => {
                self.cells.paint(place.value(), 1 << height, at, block);
                return Ok(());
            }
        };
        if self.level == self.source.depth()
            && let Some(cells) = self.source.cells(node, height)?
        {
            self.cells.copy(&cells, height, at, block);
            return Ok(());
        }
        self.source.each_child(node, |step, child| {
            let half = 1 << (height - 1);
            let at = std::array::from_fn(|axis| at[axis] + (step as u32 >> axis & 1) * half);
            self.fill(&child, height - 1, at, block)
        })
    }
}

impl<S: Source<Dim = Oct>> CellBlocks for SourceBlocks<S> {
    fn carry(&self) -> Carry {
        self.cells.carry
    }

    fn level(&self) -> u8 {
        self.level
    }

    fn state(&mut self, level: u8, node: [i64; 3]) -> Result<State> {
        let Some(code) = code_of(level, node) else { return Ok(State::Uniform(false)) };
        let place = self.place(code)?;
        if place.is_inner() && level < self.level {
            return Ok(State::Mixed);
        }
        Ok(State::Uniform(self.cells.cell(place.value()).0))
    }

    fn block(&mut self, block: [i64; 3]) -> Result<Arc<Block>> {
        let Some(code) = code_of(self.block_level(), block) else { return Ok(self.empty.clone()) };
        if let Some(found) = self.blocks[0].get(&block) {
            return Ok(found.clone());
        }
        let found = match self.blocks[1].remove(&block) {
            Some(found) => found,
            None => self.read(code)?,
        };
        self.held += found.bytes();
        if self.held > HELD {
            self.blocks[1] = std::mem::take(&mut self.blocks[0]);
            self.held = found.bytes();
        }
        self.blocks[0].insert(block, found.clone());
        Ok(found)
    }
}

/// The node's code, if it lies in the space.
fn code_of(level: u8, node: [i64; 3]) -> Option<Code<Oct>> {
    let [Ok(x), Ok(y), Ok(z)] = node.map(u32::try_from) else { return None };
    Code::from_cell(level, [x, y, z])
}

/// What is made of a tree's cells.
#[derive(Clone, Copy)]
struct Cells {
    filling: Filling,
    carry: Carry,
}

impl Cells {
    /// Whether a cell is solid, and what is carried of it.
    #[inline]
    fn cell<V: Value>(self, value: Option<V>) -> (bool, u32) {
        let fill = self.filling.fill(value);
        let told = match (self.carry, value) {
            (Carry::Nothing, _) | (_, None) => 0,
            (Carry::Coverage, _) => fill.into(),
            (Carry::Value, Some(value)) => {
                let samples = value.samples().iter().take(3);
                samples.fold(0, |told, sample| told << 8 | sample.to_f64() as u32)
            }
        };
        (fill >= HALF, told)
    }

    /// A cube of cells of one value.
    fn paint<V: Value>(self, value: Option<V>, side: u32, at: [u32; 3], block: &mut Block) {
        let (solid, told) = self.cell(value);
        if solid {
            let bits = (u32::MAX >> (SIDE - side)) << at[0];
            for z in at[2]..at[2] + side {
                let row = (z * SIDE + at[1]) as usize;
                block.solid[row..row + side as usize].iter_mut().for_each(|row| *row |= bits);
            }
        }
        if let Told::Each(each) = &mut block.told
            && told > 0
        {
            for z in at[2]..at[2] + side {
                for y in at[1]..at[1] + side {
                    let start = ((z * SIDE + y) * SIDE + at[0]) as usize;
                    each[start..start + side as usize].fill(told);
                }
            }
        }
    }

    /// Cells in Z order.
    fn copy<V: Value>(self, cells: &CellBlock<V>, height: u8, at: [u32; 3], block: &mut Block) {
        for (place, (present, value)) in cells.present.iter().zip(&cells.values).enumerate() {
            if *present > 0 {
                let Some(code) = Code::<Oct>::from_path(height, place as u64) else { continue };
                let cell = code.cell();
                self.paint(Some(*value), 1, std::array::from_fn(|axis| at[axis] + cell[axis]), block);
            }
        }
    }
}

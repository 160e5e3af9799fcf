//! Occupancy of the cells of one octree level, by their coordinates: the source-dependent code.

use std::ops::Deref;

use super::check_level;
use crate::tree::{Child, Children, Source, no_children};
use spinney_base::TreeType;
use spinney_base::space::Dimension;
use spinney_base::value::{Rule, SampleType, Value, ValueType};
use spinney_base::{Error, Result};

/// Base-2 logarithm of the cells along an edge of a brick.
pub(super) const BRICK: u8 = 3;
pub(super) const SIDE: i64 = 1 << BRICK;
pub(super) const BRICK_CELLS: usize = 1 << (3 * BRICK);

/// Minimum occupancy of cells that belong to the solid.
pub(crate) const HALF: u8 = 128;

/// Meaning of values for the occupancy of cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Filling {
    /// The value itself, 255 for a full cell: trees of [`Rule::Occupancy`] with one channel.
    Graded(ValueType),
    /// Every cell that is not VOID is full.
    Present,
}

impl Filling {
    /// Returns the meaning of a tree's values.
    pub(crate) fn of(rule: Rule, value_type: ValueType) -> Filling {
        if rule == Rule::Occupancy && value_type.channels == 1 {
            Filling::Graded(value_type)
        } else {
            Filling::Present
        }
    }

    /// Returns the occupancy of a cell with this value, 255 for full; `None` is VOID.
    #[inline]
    pub(crate) fn fill(self, value: Option<Value>) -> u8 {
        match (value, self) {
            (None, _) => 0,
            (Some(_), Filling::Present) => 255,
            // Nearly all solids: the number is the byte.
            (Some(value), Filling::Graded(ValueType { sample: SampleType::U8, .. })) => value.to_bytes()[0],
            (Some(value), Filling::Graded(value_type)) => {
                (value_type.first_sample(value) + 0.5).clamp(0.0, 255.0) as u8
            }
        }
    }
}

/// A block of cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OccupancyBlock {
    /// First cell along each axis.
    pub(super) min: [u32; 3],
    /// Number of cells along each axis.
    pub(super) side: u32,
    /// Whether all its cells are equal. The fields below are meaningful only then.
    pub(super) is_uniform: bool,
    /// Occupancy of its cells, 255 for full.
    pub(super) fill: u8,
    /// Their samples; `None` is VOID.
    pub(super) value: Option<[f64; 4]>,
}

/// One level of any kind of octree. Coordinates are cells of that level, inside the octree's space.
///
/// (A trait object, so that code that uses occupancy is compiled once and not per source.)
pub trait Occupancy: Send {
    /// Returns the level.
    fn level(&self) -> u8;

    /// Returns whether there is no finer detail anywhere, including in what the source is derived
    /// from.
    fn is_finest(&self) -> bool;

    /// Returns the largest uniform block that contains a cell, or the block of `2^smallest` cells
    /// along each axis if that is larger.
    ///
    /// # Errors
    /// If the source fails.
    fn block(&mut self, cell: [u32; 3], smallest: u8) -> Result<OccupancyBlock>;

    /// Writes the occupancy of a brick's cells, x fastest, then y, then z.
    ///
    /// # Errors
    /// If the source fails.
    fn read_brick(&mut self, brick: [u32; 3], cells: &mut [u8]) -> Result<()>;
}

/// Node type of the source that a pointer refers to.
type Node<P> = <<P as Deref>::Target as Source>::Node;

/// A level of a source, given by any kind of pointer.
///
/// It caches the path to the node that was found last, so that a neighbour only costs the levels
/// below their common ancestor.
pub(crate) struct OccupancyLevel<P: Deref<Target: Source>> {
    source: P,
    value_type: ValueType,
    level: u8,
    filling: Filling,
    is_finest: bool,
    root: Child<Node<P>>,
    /// Children of the nodes on the path from the root to the last cell, one entry per level above
    /// the cells.
    path: Vec<Children<Node<P>>>,
    /// Number of valid entries of `path`.
    known: usize,
    last: [u32; 3],
}

impl<P: Deref<Target: Source>> OccupancyLevel<P> {
    /// Creates a level of an octree. `is_finest` states that there is no finer detail, including in
    /// what the source is derived from.
    ///
    /// # Errors
    /// If the source fails, is a quadtree, or has no such level.
    pub(crate) fn new(source: P, level: u8, filling: Filling, is_finest: bool) -> Result<OccupancyLevel<P>> {
        check_octree(source.form())?;
        check_level(level, source.depth())?;
        let (root, value_type) = (source.root()?, source.form().value);
        let path = (0..level).map(|_| no_children()).collect();
        Ok(OccupancyLevel {
            source,
            value_type,
            level,
            filling,
            is_finest,
            root,
            path,
            known: 0,
            last: [0; 3],
        })
    }

    /// Returns the node of level `deepest` that contains a cell, or a uniform block of a higher
    /// level, and its level.
    fn find(&mut self, cell: [u32; 3], deepest: u8) -> Result<(&Child<Node<P>>, u8)> {
        let deepest = usize::from(deepest);
        // The highest bit in which the coordinates differ gives the lowest common ancestor of this
        // cell and the last. The children of that ancestor and of all above it are known.
        let differ = (0..3).fold(0, |bits, axis| bits | cell[axis] ^ self.last[axis]);
        let common = usize::from(self.level) - (32 - differ.leading_zeros() as usize);
        self.known = self.known.min(common + 1);
        self.last = cell;
        let step = |level: usize| {
            let bit = usize::from(self.level) - level - 1;
            (0..3).fold(0, |step, axis| step | (cell[axis] as usize >> bit & 1) << axis)
        };
        let mut level = self.known.min(deepest);
        while level < deepest {
            let (above, below) = self.path.split_at_mut(level);
            let found = above.last().map_or(&self.root, |siblings| &siblings[step(level - 1)]);
            let Child::Inner { node, .. } = found else { break };
            self.source.children(node, &mut below[0])?;
            level += 1;
            self.known = level;
        }
        let found = match level.checked_sub(1) {
            None => &self.root,
            Some(above) => &self.path[above][step(above)],
        };
        Ok((found, level as u8))
    }
}

impl<P: Deref<Target: Source> + Send> Occupancy for OccupancyLevel<P> {
    fn level(&self) -> u8 {
        self.level
    }

    fn is_finest(&self) -> bool {
        self.is_finest
    }

    fn block(&mut self, cell: [u32; 3], smallest: u8) -> Result<OccupancyBlock> {
        let (cells, filling, value_type) = (self.level, self.filling, self.value_type);
        let (found, level) = self.find(cell, cells - smallest.min(cells))?;
        let height = cells - level;
        // (At the level of the cells, finer detail does not matter.)
        let is_uniform = height == 0 || !found.is_inner();
        let value = found.value().filter(|_| is_uniform);
        Ok(OccupancyBlock {
            min: cell.map(|cell| cell >> height << height),
            side: 1 << height,
            is_uniform,
            fill: filling.fill(value),
            value: value.map(|value| value_type.samples(value).padded()),
        })
    }

    fn read_brick(&mut self, brick: [u32; 3], cells: &mut [u8]) -> Result<()> {
        let height = BRICK.min(self.level);
        let cell = brick.map(|brick| brick << BRICK);
        let finest = self.level == self.source.depth();
        let filling = self.filling;
        cells.fill(0);
        let top = self.find(cell, self.level - height)?.0.clone();
        Brick { source: &*self.source, filling, finest, cells }.read(&top, [0; 3], height)
    }
}

/// Fails unless a tree is an octree: only octrees can be solids.
///
/// # Errors
/// If it is a quadtree.
pub(super) fn check_octree(form: TreeType) -> Result<()> {
    if form.dimension == Dimension::Oct {
        return Ok(());
    }
    Err(Error::invalid("tree", "a quadtree", "an octree, since this query is for solids"))
}

/// A brick to write occupancy to.
struct Brick<'a, S: ?Sized> {
    source: &'a S,
    filling: Filling,
    /// Whether the cells are those of the source's deepest level.
    finest: bool,
    cells: &'a mut [u8],
}

impl<S: Source + ?Sized> Brick<'_, S> {
    /// Writes the occupancy of a node with `2^height` cells along each axis. Its first cell is
    /// `min` of the brick.
    fn read(&mut self, node: &Child<S::Node>, min: [usize; 3], height: u8) -> Result<()> {
        let side = SIDE as usize;
        match node {
            Child::Void => {}
            Child::Inner { node, .. } if height > 0 => {
                let mut children = no_children();
                self.source.children(node, &mut children)?;
                for (step, child) in children.iter().enumerate() {
                    let half = 1 << (height - 1);
                    let min = std::array::from_fn(|axis| min[axis] + (step >> axis & 1) * half);
                    self.read(child, min, height - 1)?;
                }
            }
            Child::Inner { node, .. } if self.filling == Filling::Present && !self.finest => {
                // Values do not store how full the node is; its children give an estimate.
                let mut children = no_children();
                self.source.children(node, &mut children)?;
                let parts = children.iter().filter(|child| !matches!(child, Child::Void)).count() as u32;
                self.cells[(min[2] * side + min[1]) * side + min[0]] = (parts * 32).min(255) as u8;
            }
            node => {
                let (fill, size) = (self.filling.fill(node.value()), 1 << height);
                for z in min[2]..min[2] + size {
                    for y in min[1]..min[1] + size {
                        self.cells[(z * side + y) * side + min[0]..][..size].fill(fill);
                    }
                }
            }
        }
        Ok(())
    }
}

//! How full the cells of one level of an octree are, found by their place: what depends on the type of the tree's values.

use crate::space::{Dimension, Oct};
use crate::tree::{Child, Source};
use crate::value::{Rule, Sample, Value};
use crate::{Error, Result};

/// Cells along an edge of a brick are `2^BRICK`.
pub(super) const BRICK: u8 = 3;
pub(super) const SIDE: i64 = 1 << BRICK;
pub(super) const BRICK_CELLS: usize = 1 << (3 * BRICK);

/// Cells that are at least this full belong to the solid.
pub(super) const HALF: u8 = 128;

/// What a value says about how full a cell is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Filling {
    /// The value itself, 255 for a full cell: trees of [`Rule::Occupancy`] with one channel.
    Graded,
    /// Whatever is not VOID is full.
    Present,
}

impl Filling {
    /// What the values of a tree say.
    pub(crate) fn of<V: Value>(rule: Rule) -> Filling {
        if rule == Rule::Occupancy && V::CHANNELS == 1 { Filling::Graded } else { Filling::Present }
    }

    /// How full a cell with this value is, 255 for full.
    #[inline]
    pub(crate) fn fill<V: Value>(self, value: Option<V>) -> u8 {
        match (value, self) {
            (None, _) => 0,
            (Some(value), Filling::Graded) => (value.samples()[0].to_f64() + 0.5).clamp(0.0, 255.0) as u8,
            (Some(_), Filling::Present) => 255,
        }
    }
}

/// A uniform block of cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Block {
    /// First cell along each axis.
    pub(super) min: [u32; 3],
    /// Cells along each axis.
    pub(super) side: u32,
    /// How full its cells are, 255 for full.
    pub(super) fill: u8,
    /// Their samples; `None` is VOID.
    pub(super) value: Option<[f64; 4]>,
}

/// One level of an octree of any type. Coordinates are cells of that level, inside the octree's space.
///
/// (An object, so that what works with occupancy is compiled once and not for each type of values.)
pub(crate) trait Occupancy: Send {
    /// The level.
    fn level(&self) -> u8;

    /// If there is nothing finer anywhere, also not behind the source.
    fn is_finest(&self) -> bool;

    /// The largest uniform block that a cell lies in.
    ///
    /// # Errors
    /// If the source fails.
    fn block(&mut self, cell: [u32; 3]) -> Result<Block>;

    /// Writes how full the cells of a brick are, x fastest, then y, then z.
    ///
    /// # Errors
    /// If the source fails.
    fn read_brick(&mut self, brick: [u32; 3], cells: &mut [u8]) -> Result<()>;
}

type Place<S> = Child<<S as Source>::Value, <S as Source>::Node>;
type Children<S> = <<S as Source>::Dim as Dimension>::Array<Place<S>>;

/// A level of a source.
///
/// It keeps the way to the node that was looked at last, so that a neighbour costs no more than the levels up to the
/// common ancestor and down again.
pub(crate) struct Level<S: Source> {
    source: S,
    level: u8,
    filling: Filling,
    is_finest: bool,
    root: Place<S>,
    /// Children of the nodes on the way to the last cell, from the root.
    path: Vec<Children<S>>,
    last: [u32; 3],
}

impl<S: Source<Dim = Oct>> Level<S> {
    /// A level of an octree; `is_finest` if there is nothing finer anywhere, also not behind the source.
    ///
    /// # Errors
    /// If the source fails or has no such level.
    pub(crate) fn new(source: S, level: u8, filling: Filling, is_finest: bool) -> Result<Level<S>> {
        check_level(&source, level)?;
        let root = source.root()?;
        Ok(Level { source, level, filling, is_finest, root, path: Vec::new(), last: [0; 3] })
    }

    /// What stands at a cell's node of level `most`, or at the uniform block that it lies in, and that one's level.
    fn find(&mut self, cell: [u32; 3], most: u8) -> Result<(&Place<S>, u8)> {
        let differ = (0..3).fold(0, |bits, axis| bits | cell[axis] ^ self.last[axis]);
        let common = usize::from(self.level) - (32 - differ.leading_zeros() as usize);
        self.path.truncate(common + 1);
        self.last = cell;
        let mut level = self.path.len().min(usize::from(most));
        let step = |level: usize| {
            let bit = usize::from(self.level) - level - 1;
            (0..3).fold(0, |step, axis| step | (cell[axis] as usize >> bit & 1) << axis)
        };
        loop {
            let place = match level.checked_sub(1) {
                None => &self.root,
                Some(above) => &self.path[above].as_ref()[step(above)],
            };
            match place {
                Child::Inner { node, .. } if level < usize::from(most) => {
                    let children = self.source.children(node)?;
                    self.path.push(children);
                    level += 1;
                }
                _ => break,
            }
        }
        // (Once more, because the borrow checker does not see that the loop has ended.)
        let place = match level.checked_sub(1) {
            None => &self.root,
            Some(above) => &self.path[above].as_ref()[step(above)],
        };
        Ok((place, level as u8))
    }
}

impl<S: Source<Dim = Oct> + Send> Occupancy for Level<S> {
    fn level(&self) -> u8 {
        self.level
    }

    fn is_finest(&self) -> bool {
        self.is_finest
    }

    fn block(&mut self, cell: [u32; 3]) -> Result<Block> {
        let (most, filling) = (self.level, self.filling);
        let (place, level) = self.find(cell, most)?;
        let value = place.value();
        let height = most - level;
        Ok(Block {
            min: cell.map(|cell| cell >> height << height),
            side: 1 << height,
            fill: filling.fill(value),
            value: value.map(samples),
        })
    }

    fn read_brick(&mut self, brick: [u32; 3], cells: &mut [u8]) -> Result<()> {
        let height = BRICK.min(self.level);
        let cell = brick.map(|brick| brick << BRICK);
        let place = self.find(cell, self.level - height)?.0.clone();
        cells.fill(0);
        let finest = self.level == self.source.depth();
        read_part(&self.source, &place, (self.filling, finest), [0; 3], height, cells)
    }
}

fn samples<V: Value>(value: V) -> [f64; 4] {
    let mut numbers = [0.0; 4];
    for (number, sample) in numbers.iter_mut().zip(value.samples()) {
        *number = sample.to_f64();
    }
    numbers
}

/// Fails if an octree has no such level.
pub(super) fn check_level(source: &impl Source<Dim = Oct>, level: u8) -> Result<()> {
    if level > source.depth() {
        return Err(Error::invalid("level", level.to_string(), format!("0 to {}", source.depth())));
    }
    Ok(())
}

/// Writes the occupancy of a node with `2^height` cells along each axis, the first of which is `min` of the brick.
fn read_part<S: Source>(
    source: &S,
    place: &Place<S>,
    (filling, finest): (Filling, bool),
    min: [usize; 3],
    height: u8,
    cells: &mut [u8],
) -> Result<()> {
    let side = SIDE as usize;
    match place {
        Child::Void => Ok(()),
        Child::Inner { node, .. } if height > 0 => source.each_child(node, |step, child| {
            let half = 1 << (height - 1);
            let min = std::array::from_fn(|axis| min[axis] + (step >> axis & 1) * half);
            read_part(source, &child, (filling, finest), min, height - 1, cells)
        }),
        Child::Inner { node, .. } if filling == Filling::Present && !finest => {
            // Values do not tell how full the node is; one look further down gives an idea.
            let mut parts = 0u32;
            source.each_child(node, |_, child| {
                parts += u32::from(!matches!(child, Child::Void));
                Ok(())
            })?;
            cells[(min[2] * side + min[1]) * side + min[0]] = (parts * 32).min(255) as u8;
            Ok(())
        }
        _ => {
            let (fill, size) = (filling.fill(place.value()), 1 << height);
            for z in min[2]..min[2] + size {
                for y in min[1]..min[1] + size {
                    cells[(z * side + y) * side + min[0]..][..size].fill(fill);
                }
            }
            Ok(())
        }
    }
}

//! One level of an octree as a field of occupancy: cells, densities between them, and gradients, looked up at random but
//! cheaply where one place is near the last.

use crate::space::Dimension;
use crate::tree::{Child, Source};
use crate::value::{Rule, Sample, Value};
use crate::{Error, Result};

/// Cells along an edge of a brick are `2^BRICK`.
const BRICK: u8 = 3;
const SIDE: i64 = 1 << BRICK;
const BRICK_CELLS: usize = 1 << (3 * BRICK);
/// Bricks that are kept: one place for each number that a brick's place is hashed to.
const SLOTS: usize = 1 << 12;

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
pub(super) struct Block<V> {
    /// First cell along each axis.
    pub(super) min: [u32; 3],
    /// Cells along each axis.
    pub(super) side: u32,
    /// `None` is VOID.
    pub(super) value: Option<V>,
}

type Place<S> = Child<<S as Source>::Value, <S as Source>::Node>;
type Children<S> = <<S as Source>::Dim as Dimension>::Array<Place<S>>;

/// One level of an octree. Coordinates are cells of that level; all that is outside is empty.
///
/// It keeps the way to the node that was looked at last, so that a neighbour costs no more than the levels up to the
/// common ancestor and down again, and the occupancy of blocks of 8 x 8 x 8 cells that were looked at lately. Memory does
/// not depend on the tree.
pub(crate) struct Field<S: Source> {
    source: S,
    level: u8,
    filling: Filling,
    is_finest: bool,
    root: Place<S>,
    /// Children of the nodes on the way to the last cell, from the root.
    path: Vec<Children<S>>,
    last: [u32; 3],
    /// Place and number of each brick that is kept, one more than it is; 0 where there is none.
    keys: Vec<u64>,
    bricks: Vec<u8>,
}

impl<S: Source> Field<S> {
    /// A level of an octree; `is_finest` if there is nothing finer anywhere, also not behind the source.
    ///
    /// # Errors
    /// If the source fails, is a quadtree, or has no such level.
    pub(crate) fn new(source: S, level: u8, filling: Filling, is_finest: bool) -> Result<Field<S>> {
        check::<S>(&source, level)?;
        let root = source.root()?;
        let (keys, bricks) = (vec![0; SLOTS], vec![0; SLOTS * BRICK_CELLS]);
        Ok(Field { source, level, filling, is_finest, root, path: Vec::new(), last: [0; 3], keys, bricks })
    }

    pub(super) fn is_finest(&self) -> bool {
        self.is_finest
    }

    pub(super) fn filling(&self) -> Filling {
        self.filling
    }

    /// Cells along each axis.
    pub(super) fn side(&self) -> u32 {
        1 << self.level
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

    /// The largest uniform block that a cell inside the tree's space lies in.
    pub(super) fn block(&mut self, cell: [u32; 3]) -> Result<Block<S::Value>> {
        let most = self.level;
        let (place, level) = self.find(cell, most)?;
        let value = place.value();
        let height = most - level;
        Ok(Block { min: cell.map(|cell| cell >> height << height), side: 1 << height, value })
    }

    /// Where the occupancy of a brick starts, which is read if it is not there.
    #[inline]
    fn brick(&mut self, brick: [u32; 3]) -> Result<usize> {
        let [x, y, z] = brick.map(u64::from);
        let key = (x | y << 20 | z << 40) + 1;
        let slot = (key.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 52) as usize;
        if self.keys[slot] != key {
            self.read_brick(brick, slot)?;
            self.keys[slot] = key;
        }
        Ok(slot * BRICK_CELLS)
    }

    #[cold]
    fn read_brick(&mut self, brick: [u32; 3], slot: usize) -> Result<()> {
        // What is half read must not be taken for the brick that was there.
        self.keys[slot] = 0;
        let height = BRICK.min(self.level);
        let most = self.level - height;
        let cell = brick.map(|brick| brick << BRICK);
        let (filling, depth) = (self.filling, self.source.depth());
        let place = self.find(cell, most)?.0.clone();
        let cells = &mut self.bricks[slot * BRICK_CELLS..][..BRICK_CELLS];
        cells.fill(0);
        let finest = self.level == depth;
        read_part(&self.source, &place, (filling, finest), [0; 3], height, cells)
    }

    /// How full a cell is, 255 for full.
    #[inline]
    pub(super) fn fill_at(&mut self, cell: [i64; 3]) -> Result<u8> {
        let side = i64::from(self.side());
        if cell.iter().any(|cell| *cell < 0 || *cell >= side) {
            return Ok(0);
        }
        let start = self.brick(cell.map(|cell| (cell >> BRICK) as u32))?;
        Ok(self.bricks[start + within(cell)])
    }

    /// How full the surroundings of a point are, 0 to 1: linear between the centres of the cells around it.
    pub(super) fn density(&mut self, point: [f64; 3]) -> Result<f64> {
        let low = point.map(|number| (number - 0.5).floor());
        let share: [f64; 3] = std::array::from_fn(|axis| point[axis] - 0.5 - low[axis]);
        let low = low.map(|number| number as i64);
        let mut fills = [0.0; 8];
        let inside =
            low.iter().all(|cell| *cell >= 0 && *cell & (SIDE - 1) < SIDE - 1 && *cell >> self.level == 0);
        if inside {
            let start = self.brick(low.map(|cell| (cell >> BRICK) as u32))? + within(low);
            for (corner, fill) in fills.iter_mut().enumerate() {
                let offset =
                    (corner & 1) + (corner >> 1 & 1) * SIDE as usize + (corner >> 2) * (SIDE * SIDE) as usize;
                *fill = f64::from(self.bricks[start + offset]);
            }
        } else {
            for (corner, fill) in fills.iter_mut().enumerate() {
                let cell = std::array::from_fn(|axis| low[axis] + (corner as i64 >> axis & 1));
                *fill = f64::from(self.fill_at(cell)?);
            }
        }
        for axis in (0..3).rev() {
            let half = 1 << axis;
            for corner in 0..half {
                fills[corner] += (fills[corner + half] - fills[corner]) * share[axis];
            }
        }
        Ok(fills[0] / 255.0)
    }

    /// The direction in which occupancy grows at a point, of any length; zeros where it does not.
    ///
    /// The first moment of the occupancy in a ball of radius `reach` around the point, weighted less towards its rim: the better known
    /// central differences see single cells, of which a digitized surface shows the steps; over a ball they average out.
    pub(super) fn gradient(&mut self, point: [f64; 3], reach: f64) -> Result<[f64; 3]> {
        let first = point.map(|number| (number - reach + 0.5).floor() as i64);
        let end = point.map(|number| (number + reach + 0.5).floor() as i64);
        let mut sum = [0.0; 3];
        for z in first[2]..end[2] {
            let dz = z as f64 + 0.5 - point[2];
            for y in first[1]..end[1] {
                let dy = y as f64 + 0.5 - point[1];
                let rest = reach * reach - dz * dz - dy * dy;
                if rest <= 0.0 {
                    continue;
                }
                for x in first[0]..end[0] {
                    let dx = x as f64 + 0.5 - point[0];
                    let weight = rest - dx * dx;
                    if weight > 0.0 {
                        let weight = weight * f64::from(self.fill_at([x, y, z])?);
                        for (sum, distance) in sum.iter_mut().zip([dx, dy, dz]) {
                            *sum += weight * distance;
                        }
                    }
                }
            }
        }
        Ok(sum)
    }
}

/// Where a cell is in its brick.
#[inline]
fn within(cell: [i64; 3]) -> usize {
    let [x, y, z] = cell.map(|cell| cell & (SIDE - 1));
    ((z << BRICK | y) << BRICK | x) as usize
}

/// Fails if a source has no such level of cells in space.
pub(super) fn check<S: Source>(source: &S, level: u8) -> Result<()> {
    if S::Dim::AXES != 3 {
        return Err(Error::invalid("tree", "a quadtree", "an octree: this is a question about solids"));
    }
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

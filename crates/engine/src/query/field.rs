//! One level of an octree as a field of occupancy: cells, densities between them, and gradients, looked up at
//! random but cheaply where one is near the last.

use super::occupancy::{BRICK, BRICK_CELLS, Occupancy, OccupancyBlock, SIDE};
use spinney_base::Result;

/// Bricks that are kept: one slot for each number that a brick's coordinates are hashed to.
const SLOTS: usize = 1 << 12;
/// Slots from a brick to its neighbour along each axis, modulo their number. Of all such numbers that were tried these keep bricks of one
/// slot the farthest apart: 15 bricks along some axis. So neighbours never drive each other out.
const STEPS: [u32; 3] = [1, 803, 2024];
/// The slot of all bricks outside of the space, which are empty.
const OUTSIDE: usize = SLOTS * BRICK_CELLS;

/// Radius of the ball of cells that a surface's normal comes from.
const REACH: f32 = 3.5;
/// Cells along each axis that such a ball can meet.
const WIDE: usize = SIDE as usize;

/// One level of an octree. Coordinates are cells of that level; all that is outside is empty.
///
/// It caches the occupancy of bricks of 8 x 8 x 8 cells, one per hash value. Memory does not depend on the
/// tree.
pub struct Field<'a> {
    cells: Box<dyn Occupancy + 'a>,
    level: u8,
    /// Coordinates of the brick in each slot as one number, and one more; 0 where there is none.
    keys: Vec<u64>,
    bricks: Vec<u8>,
}

impl<'a> Field<'a> {
    /// A field of the cells of a level.
    pub fn new(cells: impl Occupancy + 'a) -> Field<'a> {
        let (keys, bricks) = (vec![0; SLOTS], vec![0; (SLOTS + 1) * BRICK_CELLS]);
        Field { level: cells.level(), cells: Box::new(cells), keys, bricks }
    }

    pub(super) fn is_finest(&self) -> bool {
        self.cells.is_finest()
    }

    /// Cells along each axis.
    pub(super) fn side(&self) -> u32 {
        1 << self.level
    }

    /// The largest uniform block that a cell inside the tree's space lies in, or that of `2^smallest` cells along each axis.
    pub(super) fn block(&mut self, cell: [u32; 3], smallest: u8) -> Result<OccupancyBlock> {
        self.cells.block(cell, smallest)
    }

    /// Offset of a brick's occupancy, which is read if it is not there.
    #[inline]
    pub(super) fn brick(&mut self, brick: [u32; 3]) -> Result<usize> {
        let [x, y, z] = brick.map(u64::from);
        // At most 16 bits per axis: a brick is 8 cells wide, and an octree has up to 19 levels. One is added
        // to keep 0 free.
        let key = (x | y << 20 | z << 40) + 1;
        let along = |axis: usize| brick[axis].wrapping_mul(STEPS[axis]);
        let slot = along(0).wrapping_add(along(1)).wrapping_add(along(2)) as usize % SLOTS;
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
        self.cells.read_brick(brick, &mut self.bricks[slot * BRICK_CELLS..][..BRICK_CELLS])
    }

    /// Occupancy of a cell, 255 for full.
    #[inline]
    fn fill_at(&mut self, cell: [i64; 3]) -> Result<u8> {
        let side = i64::from(self.side());
        if cell.iter().any(|cell| *cell < 0 || *cell >= side) {
            return Ok(0);
        }
        let start = self.brick(cell.map(|cell| (cell >> BRICK) as u32))?;
        Ok(self.bricks[start + within(cell)])
    }

    /// Occupancy of a cell of the brick whose cells begin at an offset, 255 for full.
    #[inline]
    pub(super) fn fill_in(&self, start: usize, cell: [u32; 3]) -> u8 {
        self.bricks[start + within(cell.map(i64::from))]
    }

    /// Occupancy around a point, 0 to 1: linear between the centres of the cells around it.
    pub(super) fn density(&mut self, point: [f64; 3]) -> Result<f64> {
        let low = point.map(|number| floor(number - 0.5));
        let share: [f64; 3] = std::array::from_fn(|axis| point[axis] - 0.5 - low[axis] as f64);
        let mut fills = [0.0; 8];
        // All eight cells in one brick, which is one look-up instead of eight.
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
        // Interpolates along z, then y, then x, which are bits 2, 1 and 0 of a corner's number: each turn
        // leaves half of the corners.
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
    /// The first moment of the occupancy in a ball of 3.5 cells around the point, with weights that fall
    /// to 0 at the sphere. Central differences depend on single cells, and so show the steps of a digitized
    /// surface; over a ball these average out.
    pub(super) fn gradient(&mut self, point: [f64; 3]) -> Result<[f64; 3]> {
        // Eight cells along each axis have all of the ball, whose widest extent is seven. They lie in at most two bricks along each axis,
        // none of which takes the slot of another.
        let first = point.map(|number| floor(number - 0.5) - 3);
        let mut bricks = [OUTSIDE; 8];
        let side = 1 << self.level.saturating_sub(BRICK);
        for (corner, start) in bricks.iter_mut().enumerate() {
            let last = |axis: usize| (corner as i64 >> axis & 1) * (SIDE - 1);
            let brick: [i64; 3] = std::array::from_fn(|axis| (first[axis] + last(axis)) >> BRICK);
            if brick.iter().all(|brick| (0..side).contains(brick)) {
                *start = self.brick(brick.map(|brick| brick as u32))?;
            }
        }
        let away: [[f32; WIDE]; 3] = std::array::from_fn(|axis| {
            std::array::from_fn(|at| ((first[axis] + at as i64) as f64 + 0.5 - point[axis]) as f32)
        });
        let shift = 8 * (first[0] & (SIDE - 1)) as u32;
        let mut sums = [[0.0f32; WIDE]; 3];
        for (z, dz) in away[2].into_iter().enumerate() {
            let cz = first[2] + z as i64;
            let upper = usize::from(cz >> BRICK != first[2] >> BRICK);
            for (y, dy) in away[1].into_iter().enumerate() {
                let rest = REACH * REACH - dz * dz - dy * dy;
                if rest <= 0.0 {
                    continue;
                }
                let cy = first[1] + y as i64;
                let below = 4 * upper + 2 * usize::from(cy >> BRICK != first[1] >> BRICK);
                let row = within([0, cy, cz]);
                let [left, right] = [below, below + 1].map(|corner| self.row(bricks[corner] + row));
                // The eight cells of both rows that are wanted. (By two shifts, since none may be by all bits.)
                let fills = left >> shift | right << 1 << (63 - shift);
                if fills == 0 {
                    continue;
                }
                let fills = fills.to_le_bytes();
                for x in 0..WIDE {
                    let dx = away[0][x];
                    let weight = rest - dx * dx;
                    let moment = if weight > 0.0 { weight } else { 0.0 } * f32::from(fills[x]);
                    sums[0][x] += moment * dx;
                    sums[1][x] += moment * dy;
                    sums[2][x] += moment * dz;
                }
            }
        }
        Ok(sums.map(|sums| f64::from(sums.iter().sum::<f32>())))
    }

    /// The eight cells of a row of a brick, the first of which is the lowest byte.
    #[inline]
    fn row(&self, start: usize) -> u64 {
        let cells = self.bricks.get(start..start + SIDE as usize).and_then(|row| row.first_chunk());
        cells.map_or(0, |row| u64::from_le_bytes(*row))
    }
}

/// The whole number that is no more than this one. (The function of that name is a call on processors that are as old as programs must
/// still run on.)
#[inline]
fn floor(number: f64) -> i64 {
    let cut = number as i64;
    cut - i64::from(cut as f64 > number)
}

/// Offset of a cell in its brick.
#[inline]
fn within(cell: [i64; 3]) -> usize {
    let [x, y, z] = cell.map(|cell| cell & (SIDE - 1));
    ((z << BRICK | y) << BRICK | x) as usize
}

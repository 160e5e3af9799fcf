//! One level of an octree as a field of occupancy: cells, densities between them, and gradients, looked up at
//! random but cheaply where one is near the last.

use super::occupancy::{BRICK, BRICK_CELLS, Occupancy, OccupancyBlock, SIDE};
use spinney_base::Result;

/// Bricks that are kept: one slot for each number that a brick's coordinates are hashed to.
const SLOTS: usize = 1 << 12;

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
        let (keys, bricks) = (vec![0; SLOTS], vec![0; SLOTS * BRICK_CELLS]);
        Field { level: cells.level(), cells: Box::new(cells), keys, bricks }
    }

    pub(super) fn is_finest(&self) -> bool {
        self.cells.is_finest()
    }

    /// Cells along each axis.
    pub(super) fn side(&self) -> u32 {
        1 << self.level
    }

    /// The largest uniform block that a cell inside the tree's space lies in.
    pub(super) fn block(&mut self, cell: [u32; 3]) -> Result<OccupancyBlock> {
        self.cells.block(cell)
    }

    /// Offset of a brick's occupancy, which is read if it is not there.
    #[inline]
    fn brick(&mut self, brick: [u32; 3]) -> Result<usize> {
        let [x, y, z] = brick.map(u64::from);
        // At most 16 bits per axis: a brick is 8 cells wide, and an octree has up to 19 levels. One is added
        // to keep 0 free. Multiplication by 2^64 over the golden ratio spreads neighbours; the product's top
        // 12 bits are the slot (Knuth).
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
        self.cells.read_brick(brick, &mut self.bricks[slot * BRICK_CELLS..][..BRICK_CELLS])
    }

    /// Occupancy of a cell, 255 for full.
    #[inline]
    pub(super) fn fill_at(&mut self, cell: [i64; 3]) -> Result<u8> {
        let side = i64::from(self.side());
        if cell.iter().any(|cell| *cell < 0 || *cell >= side) {
            return Ok(0);
        }
        let start = self.brick(cell.map(|cell| (cell >> BRICK) as u32))?;
        Ok(self.bricks[start + within(cell)])
    }

    /// Occupancy around a point, 0 to 1: linear between the centres of the cells around it.
    pub(super) fn density(&mut self, point: [f64; 3]) -> Result<f64> {
        let low = point.map(|number| (number - 0.5).floor());
        let share: [f64; 3] = std::array::from_fn(|axis| point[axis] - 0.5 - low[axis]);
        let low = low.map(|number| number as i64);
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
    /// The first moment of the occupancy in a ball of radius `reach` around the point, with weights that fall
    /// to 0 at the sphere. Central differences depend on single cells, and so show the steps of a digitized
    /// surface; over a ball these average out.
    pub(super) fn gradient(&mut self, point: [f64; 3], reach: f64) -> Result<[f64; 3]> {
        let side = i64::from(self.side());
        let range = |axis: usize, reach: f64| {
            let (low, high) = (point[axis] - reach - 0.5, point[axis] + reach - 0.5);
            (low.floor() as i64 + 1).max(0)..(high.ceil() as i64).min(side)
        };
        let mut sum = [0.0; 3];
        for z in range(2, reach) {
            let dz = z as f64 + 0.5 - point[2];
            for y in range(1, reach) {
                let dy = y as f64 + 0.5 - point[1];
                let rest = reach * reach - dz * dz - dy * dy;
                if rest <= 0.0 {
                    continue;
                }
                let (mut all, mut along) = (0.0, 0.0);
                let row = range(0, rest.sqrt());
                let mut x = row.start;
                while x < row.end {
                    let end = row.end.min((x | (SIDE - 1)) + 1);
                    let start = self.brick([x, y, z].map(|cell| (cell >> BRICK) as u32))? + within([x, y, z]);
                    for (step, fill) in self.bricks[start..][..(end - x) as usize].iter().enumerate() {
                        let dx = (x + step as i64) as f64 + 0.5 - point[0];
                        let weight = (rest - dx * dx) * f64::from(*fill);
                        all += weight;
                        along += weight * dx;
                    }
                    x = end;
                }
                sum[0] += along;
                sum[1] += all * dy;
                sum[2] += all * dz;
            }
        }
        Ok(sum)
    }
}

/// Offset of a cell in its brick.
#[inline]
fn within(cell: [i64; 3]) -> usize {
    let [x, y, z] = cell.map(|cell| cell & (SIDE - 1));
    ((z << BRICK | y) << BRICK | x) as usize
}

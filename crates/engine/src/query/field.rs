//! One level of an octree as an occupancy field: cells, densities between them, and gradients.
//! Access is random but fast near the last location.

use super::occupancy::{BRICK, BRICK_CELLS, Occupancy, OccupancyBlock, SIDE};
use spinney_base::Result;

/// Number of brick slots: one brick is cached per hash of its coordinates.
const SLOTS: usize = 1 << 12;
/// Slots from a brick to its neighbour along each axis, modulo the slot count. Of all values that
/// were tried, these keep bricks with the same slot farthest apart: 15 bricks along some axis. So
/// neighbours never evict each other.
const STEPS: [u32; 3] = [1, 803, 2024];
/// Offset of the slot for all bricks outside of the space, which are empty.
const OUTSIDE: usize = SLOTS * BRICK_CELLS;

/// Radius in cells of the ball that a surface normal comes from.
const REACH: f32 = 3.5;
/// Maximum number of cells of such a ball along each axis.
const WIDE: usize = SIDE as usize;

/// One level of an octree. Coordinates are cells of that level; everything outside is empty.
///
/// It caches the occupancy of bricks of 8 x 8 x 8 cells, one per hash value. The memory does not
/// depend on the tree.
pub struct Field<'a> {
    cells: Box<dyn Occupancy + 'a>,
    level: u8,
    /// Packed coordinates of the brick in each slot plus one; 0 if the slot is empty.
    keys: Vec<u64>,
    bricks: Vec<u8>,
}

impl<'a> Field<'a> {
    /// Creates a field from the cells of a level.
    pub fn new(cells: impl Occupancy + 'a) -> Field<'a> {
        let (keys, bricks) = (vec![0; SLOTS], vec![0; (SLOTS + 1) * BRICK_CELLS]);
        Field { level: cells.level(), cells: Box::new(cells), keys, bricks }
    }

    pub(super) fn is_finest(&self) -> bool {
        self.cells.is_finest()
    }

    /// Returns the number of cells along each axis.
    pub(super) fn side(&self) -> u32 {
        1 << self.level
    }

    /// Returns the largest uniform block that contains a cell inside the tree's space, or the block
    /// of `2^smallest` cells along each axis.
    pub(super) fn block(&mut self, cell: [u32; 3], smallest: u8) -> Result<OccupancyBlock> {
        self.cells.block(cell, smallest)
    }

    /// Returns the offset of a brick's occupancy, and reads the brick if it is not cached.
    #[inline]
    pub(super) fn brick(&mut self, brick: [u32; 3]) -> Result<usize> {
        let [x, y, z] = brick.map(u64::from);
        // At most 16 bits per axis: a brick is 8 cells wide, and an octree has up to 19 levels.
        // Adding one keeps 0 free.
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
        // Invalidate the slot first: if reading fails, its content must not count as the old brick.
        self.keys[slot] = 0;
        self.cells.read_brick(brick, &mut self.bricks[slot * BRICK_CELLS..][..BRICK_CELLS])
    }

    /// Returns the occupancy of a cell, 255 for full.
    #[inline]
    fn fill_at(&mut self, cell: [i64; 3]) -> Result<u8> {
        let side = i64::from(self.side());
        if cell.iter().any(|cell| *cell < 0 || *cell >= side) {
            return Ok(0);
        }
        let start = self.brick(cell.map(|cell| (cell >> BRICK) as u32))?;
        Ok(self.bricks[start + within(cell)])
    }

    /// Returns the occupancy of a cell of the brick at an offset, 255 for full.
    #[inline]
    pub(super) fn fill_in(&self, start: usize, cell: [u32; 3]) -> u8 {
        self.bricks[start + within(cell.map(i64::from))]
    }

    /// Returns the occupancy at a point, 0 to 1, interpolated linearly between the centres of the
    /// cells around it.
    pub(super) fn density(&mut self, point: [f64; 3]) -> Result<f64> {
        let low = point.map(|number| floor(number - 0.5));
        let share: [f64; 3] = std::array::from_fn(|axis| point[axis] - 0.5 - low[axis] as f64);
        let mut fills = [0.0; 8];
        // All eight cells are in one brick: one look-up instead of eight.
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
        // Interpolate along z, then y, then x, which are bits 2, 1 and 0 of a corner's number. Each
        // iteration halves the number of corners.
        for axis in (0..3).rev() {
            let half = 1 << axis;
            for corner in 0..half {
                fills[corner] += (fills[corner + half] - fills[corner]) * share[axis];
            }
        }
        Ok(fills[0] / 255.0)
    }

    /// Returns the direction in which occupancy grows at a point, of any length; zeros if it does
    /// not grow.
    ///
    /// This is the first moment of the occupancy in a ball of radius 3.5 cells around the point,
    /// with weights that fall to 0 at the sphere. Central differences depend on single cells and
    /// show the stair steps of a digitized surface; a ball averages them out.
    pub(super) fn gradient(&mut self, point: [f64; 3]) -> Result<[f64; 3]> {
        // Eight cells along each axis enclose the ball, whose diameter is seven. They are in at
        // most two bricks along each axis, which never share a slot.
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
                // The eight cells needed from both rows. (Two shifts, since a shift by all 64 bits
                // is not allowed.)
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

    /// Returns the eight cells of a brick's row, the first as the lowest byte.
    #[inline]
    fn row(&self, start: usize) -> u64 {
        let cells = self.bricks.get(start..start + SIDE as usize).and_then(|row| row.first_chunk());
        cells.map_or(0, |row| u64::from_le_bytes(*row))
    }
}

/// Returns the largest integer not above a number. (`f64::floor` is a function call on the oldest
/// processors that the programs support.)
#[inline]
fn floor(number: f64) -> i64 {
    let cut = number as i64;
    cut - i64::from(cut as f64 > number)
}

/// Returns the offset of a cell in its brick.
#[inline]
fn within(cell: [i64; 3]) -> usize {
    let [x, y, z] = cell.map(|cell| cell & (SIDE - 1));
    ((z << BRICK | y) << BRICK | x) as usize
}

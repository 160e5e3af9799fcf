//! Cells of tiles: octree cells that divide the model, finer from level to level.

use std::collections::HashSet;

use spinney_base::space::{Dimension, morton_encode};
use spinney_brep::Face;

/// Maximum depth of cells.
const MAX_DEPTH: u32 = 21;

/// An octree cell: a one bit, followed by its position on the Z curve.
pub(super) type CellCode = u64;

/// Returns the position on the Z curve of a triangle's centroid, in a grid of so many bits.
pub(super) fn curve_position(face: &Face<'_>, bits: u8) -> u64 {
    let cell = |axis: usize| {
        let sum: i64 = face.points.iter().map(|point| i64::from(point[axis])).sum();
        morton_encode(Dimension::Oct, (((sum / 3) << MAX_DEPTH) >> bits) as u32)
    };
    cell(0) | cell(1) << 1 | cell(2) << 2
}

/// The cells of all levels. The only cell of level 0 is the whole space. Those of the next level
/// are the octants of all cells of a level. Cells with too many triangles are divided further.
#[derive(Default)]
pub(super) struct LevelCells {
    /// Cells of each level that are divided further.
    divided: Vec<HashSet<CellCode>>,
}

impl LevelCells {
    /// Adds a level whose cells are not divided yet.
    pub(super) fn add_level(&mut self) {
        self.divided.push(HashSet::new());
    }

    /// Divides a cell of the last level. Returns `false` if it has the maximum depth.
    pub(super) fn divide(&mut self, cell: CellCode) -> bool {
        let is_divisible = cell.ilog2() < 3 * MAX_DEPTH;
        if let Some(divided) = self.divided.last_mut().filter(|_| is_divisible) {
            divided.insert(cell);
        }
        is_divisible
    }

    /// Returns the cell of a level that contains a position on the curve.
    pub(super) fn cell(&self, level: usize, position: u64) -> CellCode {
        let code = |depth: u32| 1 << (3 * depth) | position >> (3 * (MAX_DEPTH - depth));
        let mut depth = 0;
        for (number, divided) in self.divided.iter().enumerate().take(level + 1) {
            depth = MAX_DEPTH.min(depth + u32::from(number > 0));
            while depth < MAX_DEPTH && divided.contains(&code(depth)) {
                depth += 1;
            }
        }
        code(depth)
    }

    /// Returns the cell of the previous level that contains a cell; `None` for level 0.
    pub(super) fn above(&self, level: usize, cell: CellCode) -> Option<CellCode> {
        let depth = cell.ilog2() / 3;
        // (The marking bit is shifted out.)
        let position = cell << (3 * (MAX_DEPTH - depth)) & !(1 << (3 * MAX_DEPTH));
        Some(self.cell(level.checked_sub(1)?, position))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_within_those_above() {
        let mut cells = LevelCells::default();
        cells.add_level();
        let far = (1 << 63) - 1;
        assert_eq!((cells.cell(0, 0), cells.cell(0, far)), (1, 1));
        cells.add_level();
        assert_eq!((cells.cell(1, 0), cells.cell(1, far)), (0o10, 0o17));
        // The first octant twice, and in it the last.
        assert!(cells.divide(0o10) && cells.divide(0o107));
        assert_eq!((cells.cell(1, 0), cells.cell(1, far >> 3)), (0o100, 0o1077));
        cells.add_level();
        assert_eq!((cells.cell(2, 0), cells.cell(2, far >> 3), cells.cell(2, far)), (0o1000, 0o10777, 0o177));
        assert_eq!((cells.above(2, 0o10777), cells.above(1, 0o1077)), (Some(0o1077), Some(1)));
        assert_eq!(cells.above(0, 1), None);
        // Cells of the maximum depth are the same at all further levels.
        for _ in 0..30 {
            cells.add_level();
        }
        let last = cells.cell(32, far);
        assert_eq!((last, cells.above(32, last), cells.divide(last)), (1 << 63 | far, Some(last), false));
    }
}

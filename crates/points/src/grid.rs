//! The integer grid of the points, and the tree over it.

use spinney_base::space::{Code, Dimension};

/// Grid of a tree's points. World coordinates are integers times a scale plus an offset, as in LAS.
#[derive(Clone, Debug, PartialEq)]
pub struct PointGrid {
    /// Size of a grid unit along each axis, in world units.
    pub scale: [f64; 3],
    /// World coordinates of the grid's origin.
    pub offset: [f64; 3],
    /// Minimum corner of the root, on the grid.
    pub corner: [i32; 3],
    /// The root measures 2^bits grid units along each axis.
    pub bits: u8,
    /// Two or three axes are divided; a quadtree spans all of z.
    pub dimension: Dimension,
}

/// Levels from a node down to its sampling cells, each of which contributes one point. The spacing
/// of a node is its side divided by 2^7 (octree) or 2^8 (quadtree).
pub(crate) fn spacing_levels(dimension: Dimension) -> u8 {
    match dimension {
        Dimension::Quad => 8,
        Dimension::Oct => 7,
    }
}

impl PointGrid {
    /// Creates the smallest grid whose root contains all positions between two corners.
    pub fn around(
        scale: [f64; 3],
        offset: [f64; 3],
        [least, most]: [[i32; 3]; 2],
        dimension: Dimension,
    ) -> PointGrid {
        let sides =
            (0..dimension.axes()).map(|axis| (i64::from(most[axis]) - i64::from(least[axis])).max(0) as u64);
        let side = sides.max().unwrap_or_default();
        let bits = (u64::BITS - side.leading_zeros()) as u8;
        PointGrid { scale, offset, corner: least, bits, dimension }
    }

    /// Level of the finest cells by which points are sorted, limited by the maximum code depth.
    pub(crate) fn code_levels(&self) -> u8 {
        self.bits.min(self.dimension.max_depth())
    }

    /// Returns the deepest level of nodes.
    pub(crate) fn deepest(&self) -> u8 {
        self.code_levels().saturating_sub(spacing_levels(self.dimension))
    }

    /// Returns the code of a position; `None` outside the root.
    #[inline]
    pub(crate) fn code(&self, position: [i32; 3]) -> Option<Code> {
        let levels = self.code_levels();
        let mut cell = [0; 3];
        for axis in 0..self.dimension.axes() {
            let steps = i64::from(position[axis]) - i64::from(self.corner[axis]);
            if steps < 0 || steps >> self.bits != 0 {
                return None;
            }
            cell[axis] = (steps >> (self.bits - levels)) as u32;
        }
        Code::from_cell(self.dimension, levels, cell)
    }

    /// Returns a node's minimum and maximum position on the grid; in a quadtree, all of z.
    pub(crate) fn node_box(&self, code: Code) -> [[i32; 3]; 2] {
        let cell = code.cell();
        let (mut least, mut most) = ([i32::MIN; 3], [i32::MAX; 3]);
        let shift = u32::from(self.bits - code.level().min(self.bits));
        for axis in 0..self.dimension.axes() {
            let first = i64::from(self.corner[axis]) + (i64::from(cell[axis]) << shift);
            let last = first + (1i64 << shift) - 1;
            least[axis] = first.clamp(i32::MIN.into(), i32::MAX.into()) as i32;
            most[axis] = last.clamp(i32::MIN.into(), i32::MAX.into()) as i32;
        }
        [least, most]
    }

    /// Converts a grid position to world coordinates.
    #[inline]
    pub fn to_world(&self, position: [i32; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| f64::from(position[axis]) * self.scale[axis] + self.offset[axis])
    }

    /// Returns the bounds of the grid positions in a world box, corners included; `None` if there
    /// are none.
    pub(crate) fn grid_box(&self, [least, most]: [[f64; 3]; 2]) -> Option<[[i32; 3]; 2]> {
        let mut positions = [[i32::MIN; 3], [i32::MAX; 3]];
        for axis in 0..3 {
            let world = |step: i64| step as f64 * self.scale[axis] + self.offset[axis];
            let guess = |to: f64| ((to - self.offset[axis]) / self.scale[axis]).clamp(-4e9, 4e9) as i64;
            // Division rounds, so the exact grid coordinate is searched for among the neighbours.
            let first =
                (-2..=2).map(|more| guess(least[axis]) + more).find(|step| world(*step) >= least[axis]);
            let last =
                (-2..=2).rev().map(|more| guess(most[axis]) + more).find(|step| world(*step) <= most[axis]);
            let (first, last) = (first?, last?);
            if first > last || first > i32::MAX.into() || last < i32::MIN.into() {
                return None;
            }
            positions[0][axis] = first.max(i32::MIN.into()) as i32;
            positions[1][axis] = last.min(i32::MAX.into()) as i32;
        }
        Some(positions)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_contain_the_positions_of_their_codes() {
        let bounds = [[-5, i32::MIN, 3], [100, i32::MAX, 9]];
        for dimension in [Dimension::Quad, Dimension::Oct] {
            let grid = PointGrid::around([1.0; 3], [0.0; 3], bounds, dimension);
            assert_eq!(grid.bits, 32);
            for position in [[-5, i32::MIN, 3], [100, i32::MAX, 9], [7, 0, 4]] {
                let code = grid.code(position).unwrap();
                for level in [0, 1, 5, code.level()] {
                    let [least, most] = grid.node_box(code.ancestor(level));
                    assert!(
                        (0..3).all(|axis| (least[axis]..=most[axis]).contains(&position[axis])),
                        "{position:?} {level}"
                    );
                }
            }
            assert_eq!(grid.code([-6, 0, 4]), None);
        }
        let point = PointGrid::around([1.0; 3], [0.0; 3], [[4; 3]; 2], Dimension::Oct);
        assert_eq!(
            (point.bits, point.code([4; 3]).map(Code::level), point.code([5, 4, 4])),
            (0, Some(0), None)
        );
    }

    #[test]
    fn world_boxes_contain_the_grid_positions_inside() {
        let grid = PointGrid::around([0.1, 0.01, 1.0], [0.3, 0.0, 5.0], [[0; 3], [100; 3]], Dimension::Oct);
        let found = grid.grid_box([[0.3, 0.29, 5.5], [0.61, 0.3, 8.0]]).unwrap();
        assert_eq!(found, [[0, 29, 1], [3, 30, 3]]);
        assert_eq!(grid.grid_box([[0.31, 0.0, 0.0], [0.39, 1.0, 1.0]]), None);
        let all = grid.grid_box([[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]]).unwrap();
        assert_eq!(all, [[i32::MIN; 3], [i32::MAX; 3]]);
    }
}

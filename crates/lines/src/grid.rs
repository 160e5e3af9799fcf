//! Integer grid of vertices, and the quadtree over it.

use crate::geometry::{FRACTION, FixedPosition, Segment};
use spinney_base::space::{Code, Dimension};

/// Grid of a tree's vertices: world coordinates are integers times `scale`, plus `offset`.
#[derive(Clone, Debug, PartialEq)]
pub struct LineGrid {
    /// Width of a grid unit in world units, along both axes.
    pub scale: f64,
    /// World coordinates of the grid's origin.
    pub offset: [f64; 2],
    /// Minimum corner of the root, in grid coordinates.
    pub corner: [i32; 2],
    /// The root has 2^bits grid units along each axis.
    pub bits: u8,
}

/// Limit of fixed-point coordinates: positions beyond are clamped.
const FAR: f64 = (1u64 << 52) as f64;

impl LineGrid {
    /// Grid with the smallest root that contains a box.
    pub(crate) fn around(scale: f64, offset: [f64; 2], [least, most]: [[i32; 2]; 2]) -> LineGrid {
        let sides = (0..2).map(|axis| (i64::from(most[axis]) - i64::from(least[axis])).max(0) as u64);
        let side = sides.max().unwrap_or_default();
        let bits = (u64::BITS - side.leading_zeros()) as u8;
        LineGrid { scale, offset, corner: least, bits }
    }

    /// Deepest level of nodes, limited by the depth of FD codes.
    pub(crate) fn deepest(&self) -> u8 {
        self.bits.min(Dimension::Quad.max_depth())
    }

    /// Code of the deepest node that is no smaller than a segment along either axis and contains
    /// its midpoint; `None` if an end is outside of the root.
    pub(crate) fn code(&self, [a, b]: Segment) -> Option<Code> {
        let mut middle = [0; 2];
        let mut side = 0;
        for axis in 0..2 {
            let steps = [a, b].map(|end| i64::from(end[axis]) - i64::from(self.corner[axis]));
            if steps.iter().any(|steps| *steps < 0 || steps >> self.bits != 0) {
                return None;
            }
            side = side.max(steps[0].abs_diff(steps[1]));
            middle[axis] = (steps[0] + steps[1]) >> 1;
        }
        // A segment is shorter than the root, so `shift` is at most `bits`.
        let shift = (u64::BITS - side.saturating_sub(1).leading_zeros()) as u8;
        let level = self.bits.saturating_sub(shift).min(self.deepest());
        let shift = self.bits - level;
        let cell = middle.map(|steps| (steps >> shift) as u32);
        Code::from_cell(Dimension::Quad, level, [cell[0], cell[1], 0])
    }

    /// Returns the world coordinates of a grid point.
    pub fn to_world(&self, position: [i32; 2]) -> [f64; 2] {
        self.world(position.map(f64::from))
    }

    /// World coordinates of a position in grid units.
    pub(crate) fn world(&self, steps: [f64; 2]) -> [f64; 2] {
        // The scale of a decimal grid (such as 0.01) is rounded, but the number of grid units per
        // world unit is exact. Dividing by it reproduces coordinates as they were written.
        std::array::from_fn(|axis| match self.steps_of_a_unit() {
            Some(count) => (steps[axis] + self.offset[axis] * count) / count,
            None => steps[axis] * self.scale + self.offset[axis],
        })
    }

    /// Length in the world of a length in grid units.
    pub(crate) fn units(&self, steps: f64) -> f64 {
        self.steps_of_a_unit().map_or(steps * self.scale, |count| steps / count)
    }

    /// Number of grid units per world unit, if it is an integer.
    fn steps_of_a_unit(&self) -> Option<f64> {
        let count = (1.0 / self.scale).round();
        (count >= 1.0 && 1.0 / count == self.scale).then_some(count)
    }

    /// Converts world coordinates to fixed point, rounded to 2^-16 of a grid unit and clamped to
    /// the supported range.
    pub(crate) fn fixed(&self, world: [f64; 2]) -> FixedPosition {
        std::array::from_fn(|axis| {
            let steps = (world[axis] - self.offset[axis]) / self.scale;
            (steps * FRACTION as f64).round().clamp(-FAR, FAR) as i64
        })
    }

    /// Whether fixed-point conversion would clamp a position.
    pub(crate) fn is_far(&self, world: [f64; 2]) -> bool {
        (0..2).any(|axis| ((world[axis] - self.offset[axis]) / self.scale * FRACTION as f64).abs() >= FAR)
    }

    /// Length of a segment in the world.
    pub(crate) fn length(&self, [a, b]: Segment) -> f64 {
        let [x, y] = [0, 1].map(|axis| (i64::from(b[axis]) - i64::from(a[axis])) as f64);
        self.units((x * x + y * y).sqrt())
    }
}

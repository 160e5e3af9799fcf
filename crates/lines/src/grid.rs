//! The grid of whole numbers that vertices lie on, and the tree over it.

use crate::geometry::{FRACTION, Place, Segment};
use spinney_base::space::{Code, Dimension};

/// Grid of the vertices of a tree: places in the world are whole numbers times a scale, with an offset.
#[derive(Clone, Debug, PartialEq)]
pub struct LineGrid {
    /// Units of the world that a step of the grid has, along both axes.
    pub scale: f64,
    /// Place in the world of the grid's origin.
    pub offset: [f64; 2],
    /// The root's least corner, on the grid.
    pub corner: [i32; 2],
    /// The root has 2^bits steps along each axis.
    pub bits: u8,
}

/// Steps from the grid's origin, in parts of a step, beyond which no place is told from another one.
const FAR: f64 = (1u64 << 52) as f64;

impl LineGrid {
    /// The smallest grid with a root around all places between two corners.
    pub(crate) fn around(scale: f64, offset: [f64; 2], [least, most]: [[i32; 2]; 2]) -> LineGrid {
        let sides = (0..2).map(|axis| (i64::from(most[axis]) - i64::from(least[axis])).max(0) as u64);
        let side = sides.max().unwrap_or_default();
        let bits = (u64::BITS - side.leading_zeros()) as u8;
        LineGrid { scale, offset, corner: least, bits }
    }

    /// The deepest level of nodes: as deep as codes go.
    pub(crate) fn deepest(&self) -> u8 {
        self.bits.min(Dimension::Quad.max_depth())
    }

    /// The code of the deepest node that is no smaller than a segment, along both axes, and has its middle; `None` if an end is not in the root.
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
        // (A segment has fewer steps than the root, so that this many are no more than the root's bits.)
        let shift = (u64::BITS - side.saturating_sub(1).leading_zeros()) as u8;
        let level = self.bits.saturating_sub(shift).min(self.deepest());
        let shift = self.bits - level;
        let cell = middle.map(|steps| (steps >> shift) as u32);
        Code::from_cell(Dimension::Quad, level, [cell[0], cell[1], 0])
    }

    /// Place in the world of a place on the grid.
    pub fn to_world(&self, place: [i32; 2]) -> [f64; 2] {
        self.world(place.map(f64::from))
    }

    /// Place in the world of a place between those of the grid, in steps.
    pub(crate) fn world(&self, steps: [f64; 2]) -> [f64; 2] {
        // (A grid of decimal digits has a scale that is rounded; how many steps a unit has is not, and so coordinates come out as they were written.)
        std::array::from_fn(|axis| match self.steps_of_a_unit() {
            Some(count) => (steps[axis] + self.offset[axis] * count) / count,
            None => steps[axis] * self.scale + self.offset[axis],
        })
    }

    /// The length in the world of so many steps.
    pub(crate) fn units(&self, steps: f64) -> f64 {
        self.steps_of_a_unit().map_or(steps * self.scale, |count| steps / count)
    }

    /// How many steps a unit has, if it has a whole number of them.
    fn steps_of_a_unit(&self) -> Option<f64> {
        let count = (1.0 / self.scale).round();
        (count >= 1.0 && 1.0 / count == self.scale).then_some(count)
    }

    /// A place in the world, to the nearest 2^-16 of a step; what is very far away is nearer.
    pub(crate) fn fixed(&self, world: [f64; 2]) -> Place {
        std::array::from_fn(|axis| {
            let steps = (world[axis] - self.offset[axis]) / self.scale;
            (steps * FRACTION as f64).round().clamp(-FAR, FAR) as i64
        })
    }

    /// Whether a place is too far away to be told from others.
    pub(crate) fn is_far(&self, world: [f64; 2]) -> bool {
        (0..2).any(|axis| ((world[axis] - self.offset[axis]) / self.scale * FRACTION as f64).abs() >= FAR)
    }

    /// Length in the world of a segment.
    pub(crate) fn length(&self, [a, b]: Segment) -> f64 {
        let [x, y] = [0, 1].map(|axis| (i64::from(b[axis]) - i64::from(a[axis])) as f64);
        self.units((x * x + y * y).sqrt())
    }
}

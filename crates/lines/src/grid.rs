//! Integer grid of vertices, and the tree over it.

use crate::geometry::{FRACTION, FixedPosition, Segment};
use spinney_base::space::{Code, Dimension};

/// Axes that a query's distances and crossings combine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LineAxes {
    /// x and y, regardless of heights.
    Plane,
    /// All axes of the tree.
    Space,
}

impl LineAxes {
    /// Ends of a segment, or corners of a box, without coordinates that do not count.
    #[inline]
    pub(crate) fn of(self, ends: [FixedPosition; 2]) -> [FixedPosition; 2] {
        match self {
            LineAxes::Space => ends,
            LineAxes::Plane => ends.map(|[x, y, _]| [x, y, 0]),
        }
    }
}

/// Grid of a tree's vertices: world coordinates are integers times `scale`, plus `offset`.
#[derive(Clone, Debug, PartialEq)]
pub struct LineGrid {
    /// Size of a grid unit along each axis, in world units. It is equal along x and y, and along z,
    /// too, if that has their unit.
    pub scale: [f64; 3],
    /// World coordinates of the grid's origin.
    pub offset: [f64; 3],
    /// Minimum corner of the root, in grid coordinates.
    pub corner: [i32; 3],
    /// The root has 2^bits grid units along each axis.
    pub bits: u8,
    /// Two or three axes. With two, z of all positions is 0 and not stored.
    pub dimension: Dimension,
    /// Whether z has the unit of x and y. If not (x and y are degrees), lengths and distances are
    /// those in x and y.
    pub(crate) has_one_unit: bool,
}

/// Limit of fixed-point coordinates: positions beyond are clamped.
const FAR: f64 = (1u64 << 52) as f64;

impl LineGrid {
    /// Grid with the smallest root that contains a box.
    pub(crate) fn around(
        (scale, offset): ([f64; 3], [f64; 3]),
        [least, most]: [[i32; 3]; 2],
        (dimension, has_one_unit): (Dimension, bool),
    ) -> LineGrid {
        let sides =
            (0..dimension.axes()).map(|axis| (i64::from(most[axis]) - i64::from(least[axis])).max(0) as u64);
        let side = sides.max().unwrap_or_default();
        let bits = (u64::BITS - side.leading_zeros()) as u8;
        LineGrid { scale, offset, corner: least, bits, dimension, has_one_unit }
    }

    /// Returns the number of axes, 2 or 3.
    pub fn axes(&self) -> usize {
        self.dimension.axes()
    }

    /// Returns whether lengths and distances are those in space: there are three axes with one
    /// unit.
    pub fn measures_space(&self) -> bool {
        self.axes() == 3 && self.has_one_unit
    }

    /// Axes of a query with these positions: all axes if distances are those in space and the
    /// positions have heights, otherwise x and y.
    pub(crate) fn axes_for(&self, positions: &[[f64; 3]]) -> LineAxes {
        match self.measures_space() && positions.iter().all(|[.., z]| !z.is_nan()) {
            true => LineAxes::Space,
            false => LineAxes::Plane,
        }
    }

    /// Deepest level of nodes, limited by the depth of FD codes.
    pub(crate) fn deepest(&self) -> u8 {
        self.bits.min(self.dimension.max_depth())
    }

    /// Code of the deepest node that is no smaller than a segment along any axis and contains its
    /// midpoint; `None` if an end is outside of the root.
    pub(crate) fn code(&self, [a, b]: Segment) -> Option<Code> {
        let mut middle = [0; 3];
        let mut side = 0;
        for axis in 0..self.axes() {
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
        Code::from_cell(self.dimension, level, middle.map(|steps| (steps >> shift) as u32))
    }

    /// Returns the world coordinates of a grid point.
    pub fn to_world(&self, position: [i32; 3]) -> [f64; 3] {
        self.world(position.map(f64::from))
    }

    /// World coordinates of a position in grid units.
    pub(crate) fn world(&self, steps: [f64; 3]) -> [f64; 3] {
        // The scale of a decimal grid (such as 0.01) is rounded, but the number of grid units per
        // world unit is exact. Dividing by it reproduces coordinates as they were written.
        std::array::from_fn(|axis| match self.steps_of_a_unit(axis) {
            Some(count) => (steps[axis] + self.offset[axis] * count) / count,
            None => steps[axis] * self.scale[axis] + self.offset[axis],
        })
    }

    /// Length in the world of a length in grid units of x and y.
    pub(crate) fn units(&self, steps: f64) -> f64 {
        self.steps_of_a_unit(0).map_or(steps * self.scale[0], |count| steps / count)
    }

    /// Number of grid units per world unit along an axis, if it is an integer.
    fn steps_of_a_unit(&self, axis: usize) -> Option<f64> {
        let count = (1.0 / self.scale[axis]).round();
        (count >= 1.0 && 1.0 / count == self.scale[axis]).then_some(count)
    }

    /// Fixed-point coordinate along an axis of a world coordinate, not rounded.
    fn fixed_number(&self, axis: usize, number: f64) -> f64 {
        (number - self.offset[axis]) / self.scale[axis] * FRACTION as f64
    }

    /// Number of axes whose coordinates count in a query.
    fn counted(&self, axes: LineAxes) -> usize {
        if axes == LineAxes::Plane { 2 } else { self.axes() }
    }

    /// Converts world coordinates to fixed point, rounded to 2^-16 of a grid unit and clamped to
    /// the supported range. Coordinates that do not count become 0.
    pub(crate) fn fixed(&self, world: [f64; 3], axes: LineAxes) -> FixedPosition {
        let mut fixed = [0; 3];
        for (axis, fixed) in fixed.iter_mut().enumerate().take(self.counted(axes)) {
            *fixed = self.fixed_number(axis, world[axis]).round().clamp(-FAR, FAR) as i64;
        }
        fixed
    }

    /// Whether fixed-point conversion would clamp a position.
    pub(crate) fn is_far(&self, world: [f64; 3], axes: LineAxes) -> bool {
        (0..self.counted(axes)).any(|axis| self.fixed_number(axis, world[axis]).abs() >= FAR)
    }

    /// Length of a segment in the world; that in x and y if heights have another unit.
    pub(crate) fn length(&self, [a, b]: Segment) -> f64 {
        let [x, y, z] = [0, 1, 2].map(|axis| (i64::from(b[axis]) - i64::from(a[axis])) as f64);
        let z = if self.measures_space() { z } else { 0.0 };
        self.units((x * x + y * y + z * z).sqrt())
    }
}

//! Octants of a region that a triangle reaches into.

use super::grid::{Grid, Triangle};
use spinney_base::space::{Code, CodeRange, Dimension};
use spinney_brep::geometry::{Intersection, Stage, triangle};

/// Octants of a region, for a triangle that reaches into the region.
pub(super) struct Octants<'t> {
    triangle: &'t Triangle,
    /// Grid coordinates of the region's minimum corner.
    min: [i32; 3],
    /// Width of an octant.
    half: i32,
    /// Halves that the triangle's bounding box reaches into along each axis; walls belong to
    /// neither.
    halves: [[bool; 2]; 3],
    /// Whether that is at most one half along each axis.
    is_in_one: bool,
}

impl<'t> Octants<'t> {
    /// Octants of a region with this minimum corner and width.
    pub(super) fn of(triangle: &'t Triangle, min: [i32; 3], width: i32) -> Octants<'t> {
        let half = width / 2;
        let halves: [[bool; 2]; 3] = std::array::from_fn(|axis| {
            let (low, high) = (triangle.min(axis), triangle.max(axis));
            let (middle, end) = (min[axis] + half, min[axis] + width);
            [low < middle && high > min[axis], low < end && high > middle]
        });
        let is_in_one = halves.iter().all(|[low, high]| !(*low && *high));
        Octants { triangle, min, half, halves, is_in_one }
    }

    /// Whether the triangle cuts an octant.
    pub(super) fn test(&self, octant: usize) -> Intersection {
        if (0..3).any(|axis| !self.halves[axis][octant >> axis & 1]) {
            return Intersection { cuts: false, stage: Stage::Boxes };
        }
        // The box is in one half along each axis, so in one octant. A triangle that cuts the region
        // cuts this octant without further tests.
        if self.is_in_one {
            return Intersection { cuts: true, stage: Stage::Boxes };
        }
        let wide = |at: [i32; 3]| at.map(i64::from);
        let low: [i32; 3] =
            std::array::from_fn(|axis| self.min[axis] + (octant >> axis & 1) as i32 * self.half);
        let high = low.map(|low| low + self.half);
        triangle::intersect(&self.triangle.corners.map(wide), wide(low), wide(high))
    }
}

/// Whether a triangle reaches into a node of a run, by the same tests as dividing regions from the
/// root.
pub(super) fn is_in_run(run: CodeRange, grid: &Grid, triangle: &Triangle) -> bool {
    let width = grid.cell() << grid.depth;
    is_in_node(run, triangle, (Code::root(Dimension::Oct), [0; 3], width))
}

fn is_in_node(run: CodeRange, triangle: &Triangle, (code, min, width): (Code, [i32; 3], i32)) -> bool {
    if run.contains(code) {
        return true;
    }
    // Invariant: these are the tests of a single-process build from the root, in the same order. A
    // node therefore has the same triangles, regardless of how little of the surface was kept.
    // (Runs are cut at nodes above the cells.)
    let octants = Octants::of(triangle, min, width);
    (0..8).filter(|octant| run.touches(code.child(*octant))).any(|octant| {
        let corner = std::array::from_fn(|axis| min[axis] + (octant >> axis & 1) as i32 * octants.half);
        octants.test(octant).cuts && is_in_node(run, triangle, (code.child(octant), corner, octants.half))
    })
}

//! Division of a cell: the children that a face cuts, and the changes of winding numbers between
//! their corners.

use super::cells::Cell;
use crate::exact::crossing::{FinePoint, Outline};
use crate::geometry::{Box3, GridPolygon, Stage, Stages, triangle};

/// Paths from the first child's minimum corner to those of the other children: from child, to
/// child, axis.
///
/// Invariant: each path begins where an earlier one ended, the first at the cell's own corner, and
/// one ends at each child. Winding numbers are accumulated in this order; a path that begins too
/// early would use a wrong one.
const WAYS: [(usize, usize, usize); 7] =
    [(0, 4, 2), (0, 2, 1), (4, 6, 1), (0, 1, 0), (2, 3, 0), (4, 5, 0), (6, 7, 0)];

const _: () = {
    let (mut known, mut way) = (1u8, 0);
    while way < WAYS.len() {
        assert!(known >> WAYS[way].0 & 1 == 1, "a path starts where no earlier one ended");
        known |= 1 << WAYS[way].1;
        way += 1;
    }
    assert!(known == 0xff, "no path leads to a child");
};

/// The lower children along each axis, as bits.
const LOWER: [u8; 3] = [0b0101_0101, 0b0011_0011, 0b0000_1111];

/// Corners of the children, and the centre of a cell.
pub(super) struct Division {
    /// In half units of the grid.
    min: [i64; 3],
    half: i64,
    /// The largest grid points below the minimum corner, and below the centre. Walls are between
    /// grid points.
    below_min: [i32; 3],
    below_middle: [i32; 3],
}

/// The reach of a face that cuts a cell, by its bounds.
#[derive(Clone, Copy)]
pub(super) struct Reach {
    /// Children, as bits.
    children: u8,
    /// Along each axis, whether the face spans the minimum corners' coordinate of the lower
    /// children, and of the upper ones.
    spans: [[bool; 2]; 3],
}

impl Reach {
    /// Returns the child of a face that reaches no other: a face that cuts the cell cuts this child
    /// without further tests.
    #[inline]
    pub(super) fn only_child(self, stages: &mut Stages) -> Option<u8> {
        stages.disjoint[Stage::Boxes as usize] += u64::from(self.children.count_zeros());
        let is_alone = self.children.is_power_of_two();
        stages.cutting[Stage::Boxes as usize] += u64::from(is_alone);
        is_alone.then_some(self.children)
    }
}

impl Division {
    pub(super) fn of(cell: &Cell, bits: u8) -> Division {
        let (min, width) = cell.bounds(bits);
        let half = width / 2;
        // Invariant: the walls of cells and their children are halfway between grid points, at odd
        // half units, as long as cells of one grid unit are not divided. So no vertex is on a wall:
        // it is in exactly one child, which comparisons with the largest grid points below the
        // walls determine.
        debug_assert!(half >= 2);
        let below = |at: i64| at.div_euclid(2) as i32;
        Division { min, half, below_min: min.map(below), below_middle: min.map(|min| below(min + half)) }
    }

    /// Returns the minimum corner of a child.
    fn corner(&self, child: usize) -> [i64; 3] {
        std::array::from_fn(|axis| self.min[axis] + if child >> axis & 1 == 1 { self.half } else { 0 })
    }

    /// Returns the reach of a face that cuts the cell and has these bounds, in grid units.
    #[inline]
    pub(super) fn reach(&self, [low, high]: &[[i32; 3]; 2]) -> Reach {
        let mut reach = Reach { children: 0xff, spans: [[false; 2]; 3] };
        for (axis, lower) in LOWER.into_iter().enumerate() {
            let is_below = low[axis] <= self.below_middle[axis];
            let is_above = high[axis] > self.below_middle[axis];
            reach.children &= (u8::from(is_below) * lower) | (u8::from(is_above) * !lower);
            reach.spans[axis] = [low[axis] <= self.below_min[axis], is_below & is_above];
        }
        reach
    }

    /// Returns the children that a triangle cuts, as bits, if it reaches several: the five-stage
    /// test, for all of them at once.
    #[inline]
    pub(super) fn children_of_triangle(
        &self,
        reach: Reach,
        corners: &[[i32; 3]; 3],
        normal: [i64; 3],
        stages: &mut Stages,
    ) -> u8 {
        // Relative to the cell's centre. No vertex is on a wall of the cell or of a child.
        let middle = self.min.map(|min| min + self.half);
        let points = corners.map(|corner| [0, 1, 2].map(|axis| 2 * i64::from(corner[axis]) - middle[axis]));
        let mut children = 0u8;
        for point in &points {
            let child = (0..3).map(|axis| usize::from(point[axis] > 0) << axis).sum::<usize>();
            let is_inside = point.iter().all(|at| at.abs() < self.half);
            children |= u8::from(is_inside) << child;
        }
        stages.cutting[Stage::Vertices as usize] += u64::from(children.count_ones());
        let quarter = self.half / 2;
        each_bit(reach.children & !children, |child| {
            let centre = [0, 1, 2].map(|axis| if child >> axis & 1 == 1 { quarter } else { -quarter });
            let points = points.map(|point| [0, 1, 2].map(|axis| point[axis] - centre[axis]));
            let found = triangle::intersect_cube(&points, normal, quarter);
            stages.count(found);
            children |= u8::from(found.cuts) << child;
        });
        children
    }

    /// Returns the children that a polygon cuts, as bits, if it reaches several.
    pub(super) fn children_of_polygon(&self, reach: Reach, polygon: &GridPolygon, stages: &mut Stages) -> u8 {
        let mut children = 0;
        each_bit(reach.children, |child| {
            let min = self.corner(child);
            let found = polygon.cuts(&Box3 { min, max: min.map(|min| min + self.half) });
            stages.count(found);
            children |= u8::from(found.cuts) << child;
        });
        children
    }

    /// Adds a face's changes of the winding number on each of the paths between the children's
    /// corners.
    #[inline]
    pub(super) fn count_changes<'a>(
        &self,
        reach: Reach,
        outline: impl FnOnce() -> Outline<'a>,
        changes: &mut [i32; 7],
    ) {
        // Invariant: only the faces of a cell change winding numbers on these paths. Corners are
        // perturbed towards larger coordinates, so paths along the cell's walls run inside of it.
        // If a face was missed that touches the cell from outside, the whole child would be inside
        // out.
        // Most faces cross no path, since paths are at two corner coordinates.
        if reach.spans.iter().filter(|[low, high]| low | high).count() < 2 {
            return;
        }
        let outline = outline();
        for (change, (from, to, axis)) in changes.iter_mut().zip(WAYS) {
            if (0..3).all(|other| other == axis || reach.spans[other][from >> other & 1]) {
                let start = FinePoint { at: self.corner(from), bits: 1 };
                *change += outline.change_along(axis, &start, self.corner(to)[axis]);
            }
        }
    }

    /// Returns the children of a cell, given the changes on the paths between their corners.
    pub(super) fn cells(cell: &Cell, changes: [i32; 7]) -> [Cell; 8] {
        let mut windings = [cell.winding; 8];
        for (way, (from, to, _)) in WAYS.into_iter().enumerate() {
            windings[to] = windings[from] + changes[way];
        }
        std::array::from_fn(|child| cell.child(child, windings[child]))
    }
}

/// Calls a function with the index of each bit that is set.
#[inline]
pub(super) fn each_bit(mut bits: u8, mut each: impl FnMut(usize)) {
    while bits != 0 {
        each(bits.trailing_zeros() as usize);
        bits &= bits - 1;
    }
}

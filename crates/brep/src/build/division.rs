//! Division of a cell: which of its children a face cuts, and how winding numbers change between their corners.

use super::cells::Cell;
use crate::exact::crossing::{FinePoint, Outline};
use crate::geometry::{Box3, GridPolygon, Stage, Stages, triangle};

/// The ways from the least corner of a cell's first child to those of the others: child from, child to, axis.
///
/// Invariant: each begins where one before it has ended, the first at the cell's own corner, and one leads to each
/// child. Winding numbers are added up in this order: a child before its beginning would get that of another.
const WAYS: [(usize, usize, usize); 7] =
    [(0, 4, 2), (0, 2, 1), (4, 6, 1), (0, 1, 0), (2, 3, 0), (4, 5, 0), (6, 7, 0)];

const _: () = {
    let (mut known, mut way) = (1u8, 0);
    while way < WAYS.len() {
        assert!(known >> WAYS[way].0 & 1 == 1, "a way begins where none has ended");
        known |= 1 << WAYS[way].1;
        way += 1;
    }
    assert!(known == 0xff, "a child to which no way leads");
};

/// The lower children along each axis, as bits.
const LOWER: [u8; 3] = [0b0101_0101, 0b0011_0011, 0b0000_1111];

/// Corners of the children, and the middle of a cell: what a cell is divided with.
pub(super) struct Division {
    /// In half units of the grid.
    min: [i64; 3],
    half: i64,
    /// The greatest points of the grid below the least corner, and below the middle. Walls lie between points.
    below_min: [i32; 3],
    below_middle: [i32; 3],
}

/// Reach of a face that cuts a cell, by its bounds.
#[derive(Clone, Copy)]
pub(super) struct Reach {
    /// Children, as bits.
    children: u8,
    /// Along each axis, whether it spans the coordinate of the lower children's least corners, and the upper ones'.
    spans: [[bool; 2]; 3],
}

impl Reach {
    /// The child of a face that reaches no other: what cuts the cell cuts that child, untested.
    #[inline]
    pub(super) fn only_child(self, stages: &mut Stages) -> Option<u8> {
        stages.apart[Stage::Boxes as usize] += u64::from(self.children.count_zeros());
        let is_alone = self.children.is_power_of_two();
        stages.cutting[Stage::Boxes as usize] += u64::from(is_alone);
        is_alone.then_some(self.children)
    }
}

impl Division {
    pub(super) fn of(cell: &Cell, bits: u8) -> Division {
        let (min, width) = cell.bounds(bits);
        let half = width / 2;
        // Invariant: walls of cells and of their children lie in the middle between points of the grid: at
        // odd half units, as long as cells of one step are not divided. So no corner lies on a wall: it is in
        // one child, and comparing with the greatest points below a wall is enough to tell in which.
        debug_assert!(half >= 2);
        let below = |at: i64| at.div_euclid(2) as i32;
        Division { min, half, below_min: min.map(below), below_middle: min.map(|min| below(min + half)) }
    }

    /// The least corner of a child.
    fn corner(&self, child: usize) -> [i64; 3] {
        std::array::from_fn(|axis| self.min[axis] + if child >> axis & 1 == 1 { self.half } else { 0 })
    }

    /// Finds the reach of a face that cuts the cell and has these bounds, in grid units.
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

    /// Which children a triangle cuts that reaches several, as bits: the five-stage test, for all of them at once.
    #[inline]
    pub(super) fn children_of_triangle(
        &self,
        reach: Reach,
        corners: &[[i32; 3]; 3],
        normal: [i64; 3],
        stages: &mut Stages,
    ) -> u8 {
        // From the cell's middle. No corner lies on a wall of the cell or of a child.
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

    /// Which children a polygon cuts that reaches several, as bits.
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

    /// Adds the changes of the winding number that a face makes on each of the ways between the children's corners.
    #[inline]
    pub(super) fn count_changes<'a>(
        &self,
        reach: Reach,
        outline: impl FnOnce() -> Outline<'a>,
        changes: &mut [i32; 7],
    ) {
        // Invariant: the faces of a cell are all that change winding numbers on these ways. Corners are moved
        // to greater coordinates, so that ways along the walls of the cell run inside of it. If a face were
        // missed that touches the cell from outside, all below the child would be inside out.
        // Most faces meet no way: these lie along two coordinates of corners.
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

    /// The children of a cell with these changes on the ways between their corners.
    pub(super) fn cells(cell: &Cell, changes: [i32; 7]) -> [Cell; 8] {
        let mut windings = [cell.winding; 8];
        for (way, (from, to, _)) in WAYS.into_iter().enumerate() {
            windings[to] = windings[from] + changes[way];
        }
        std::array::from_fn(|child| cell.child(child, windings[child]))
    }
}

/// Calls a function with the place of each bit that is set.
#[inline]
pub(super) fn each_bit(mut bits: u8, mut each: impl FnMut(usize)) {
    while bits != 0 {
        each(bits.trailing_zeros() as usize);
        bits &= bits - 1;
    }
}

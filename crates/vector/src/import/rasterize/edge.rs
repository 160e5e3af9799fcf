//! Edges on a sub-cell integer grid, with exact predicates.
//!
//! Query points are cell centres with a symbolic perturbation: an infinitesimal shift to the right,
//! and an even smaller one up. No edge thus passes through a query point, and of two polygons that
//! share an edge exactly one contains it (simulation of simplicity, Edelsbrunner and Muecke, 1990).

use std::cmp::Ordering;

/// Grid units per cell along an axis; vertices are rounded to integers.
pub(super) const PARTS: i64 = 1 << 16;

/// Maximum distance of a vertex from the tree's corner, in cells. Differences in grid units are
/// then below 2^62, and sums of a few products of two differences below 2^127.
pub(super) const MAX_CELLS: f64 = (1u64 << 44) as f64;

/// Point in grid units.
pub(super) type Point = [i64; 2];

/// Edge between consecutive vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Edge {
    pub(super) a: Point,
    pub(super) b: Point,
}

/// Returns the centre of a cell along an axis.
#[inline]
pub(super) fn centre(cell: i64) -> i64 {
    cell * PARTS + PARTS / 2
}

/// Compares `a * b` with `c * d` exactly; all numbers are below 2^62.
#[inline]
fn compare_products([a, b]: [i64; 2], [c, d]: [i64; 2]) -> Ordering {
    let (one, other) = (a as f64 * b as f64, c as f64 * d as f64);
    // Each factor and each product has a relative error of at most 2^-53.
    const ROUNDING: f64 = 8.0 * f64::EPSILON;
    let difference = one - other;
    if difference.abs() > ROUNDING * (one.abs() + other.abs()) {
        return if difference > 0.0 { Ordering::Greater } else { Ordering::Less };
    }
    (i128::from(a) * i128::from(b)).cmp(&(i128::from(c) * i128::from(d)))
}

/// Returns the product of two numbers as its upper and lower 128 bits.
fn wide_product(a: u128, b: u128) -> (u128, u128) {
    const LOW: u128 = u64::MAX as u128;
    let (a, b) = ([a & LOW, a >> 64], [b & LOW, b >> 64]);
    let low = a[0] * b[0];
    let middle = a[1] * b[0] + (low >> 64);
    let other = a[0] * b[1] + (middle & LOW);
    (a[1] * b[1] + (middle >> 64) + (other >> 64), other << 64 | low & LOW)
}

impl Edge {
    /// Returns the minimum and maximum coordinate along an axis.
    #[inline]
    pub(super) fn range(&self, axis: usize) -> [i64; 2] {
        let (a, b) = (self.a[axis], self.b[axis]);
        [a.min(b), a.max(b)]
    }

    /// Returns the edge, directed upwards along an axis.
    #[inline]
    pub(super) fn rising(&self, axis: usize) -> Edge {
        if self.a[axis] <= self.b[axis] { *self } else { Edge { a: self.b, b: self.a } }
    }

    /// Returns whether the edge crosses a line perpendicular to an axis. An end on the line counts
    /// as below it.
    #[inline]
    pub(super) fn passes(&self, axis: usize, at: i64) -> bool {
        (self.a[axis] > at) != (self.b[axis] > at)
    }

    /// Returns whether an edge that crosses a point's row does so to the right of the point.
    #[inline]
    pub(super) fn is_right_of(&self, [x, y]: Point) -> bool {
        let Edge { a, b } = self.rising(1);
        compare_products([y - a[1], b[0] - a[0]], [x - a[0], b[1] - a[1]]) == Ordering::Greater
    }

    /// Returns whether an edge that crosses a point's column does so above the point.
    #[inline]
    pub(super) fn is_above(&self, [x, y]: Point) -> bool {
        let Edge { a, b } = self.rising(0);
        match compare_products([x - a[0], b[1] - a[1]], [y - a[1], b[0] - a[0]]) {
            Ordering::Equal => b[1] > a[1],
            other => other == Ordering::Greater,
        }
    }

    /// Returns the edge's contribution to the winding number of a point: that of a crossing to its
    /// right.
    pub(super) fn winding(&self, point: Point) -> i32 {
        match self.passes(1, point[1]) && self.is_right_of(point) {
            true => self.direction(1),
            false => 0,
        }
    }

    /// Returns 1 if the coordinate increases along the edge, otherwise -1.
    #[inline]
    pub(super) fn direction(&self, axis: usize) -> i32 {
        if self.b[axis] > self.a[axis] { 1 } else { -1 }
    }

    /// Returns the change of the winding number on the path from a point to another one on its
    /// right.
    #[inline]
    pub(super) fn on_the_way_right(&self, from: Point, to: i64) -> i32 {
        let is_met = self.passes(1, from[1]) && self.is_right_of(from) && !self.is_right_of([to, from[1]]);
        if is_met { -self.direction(1) } else { 0 }
    }

    /// Returns the change of the winding number on the path from a point to another one above it.
    #[inline]
    pub(super) fn on_the_way_up(&self, from: Point, to: i64) -> i32 {
        let is_met = self.passes(0, from[0]) && self.is_above(from) && !self.is_above([from[0], to]);
        if is_met { self.direction(0) } else { 0 }
    }

    /// Returns whether both coordinates increase along the edge, in one of its directions.
    pub(super) fn leads_right_and_up(&self) -> bool {
        let Edge { a, b } = self.rising(1);
        a[1] < b[1] && a[0] < b[0]
    }

    /// Returns whether the edge may meet a box, including its sides. There are no false negatives.
    pub(super) fn may_meet(&self, low: Point, high: Point) -> bool {
        for axis in 0..2 {
            let [least, most] = self.range(axis);
            if most < low[axis] || least > high[axis] {
                return false;
            }
        }
        // The box meets the edge's line if its corners are on both sides of the line, or on it.
        let (dx, dy) = (self.b[0] - self.a[0], self.b[1] - self.a[1]);
        let side = |x: i64, y: i64| compare_products([dx, y - self.a[1]], [dy, x - self.a[0]]);
        let first = side(low[0], low[1]);
        let others = [side(high[0], low[1]), side(low[0], high[1]), side(high[0], high[1])];
        first == Ordering::Equal || others.iter().any(|other| *other != first)
    }

    /// Returns whether the distance of a point from the edge is at most `radius`, which is below
    /// 2^60.
    pub(super) fn is_within(&self, radius: i64, [x, y]: Point) -> bool {
        let Edge { a, b } = self;
        let (dx, dy, px, py) = (b[0] - a[0], b[1] - a[1], x - a[0], y - a[1]);
        let product = |a: i64, b: i64| i128::from(a) * i128::from(b);
        let squared = product(radius, radius);
        let length = product(dx, dx) + product(dy, dy);
        // Projection of the point on the edge, times the length of the edge.
        let along = product(dx, px) + product(dy, py);
        if along <= 0 {
            return product(px, px) + product(py, py) <= squared;
        }
        if along >= length {
            let (qx, qy) = (x - b[0], y - b[1]);
            return product(qx, qx) + product(qy, qy) <= squared;
        }
        let (one, other) = (dx as f64 * py as f64, dy as f64 * px as f64);
        let (away, most) = ((one - other).abs(), radius as f64 * (length as f64).sqrt());
        let rounding = 16.0 * f64::EPSILON * (one.abs() + other.abs() + most);
        if (away - most).abs() > rounding {
            return away < most;
        }
        let away = (product(dx, py) - product(dy, px)).unsigned_abs();
        wide_product(away, away) <= wide_product(squared.unsigned_abs(), length.unsigned_abs())
    }

    /// Returns the first of `columns` columns whose centre is not left of the edge, in a row that
    /// the edge crosses. `first` is the centre of column 0.
    #[inline]
    pub(super) fn column(&self, first: Point, columns: i64) -> i64 {
        let Edge { a, b } = self.rising(1);
        let slope = (b[0] - a[0]) as f64 / (b[1] - a[1]) as f64;
        let at = (a[0] - first[0]) as f64 + (first[1] - a[1]) as f64 * slope;
        let about = (at / PARTS as f64).ceil().clamp(0.0, columns as f64);
        let mut column = about as i64;
        // Correct for rounding.
        let is_right = |column: i64| self.is_right_of([first[0] + column * PARTS, first[1]]);
        while column > 0 && !is_right(column - 1) {
            column -= 1;
        }
        while column < columns && is_right(column) {
            column += 1;
        }
        column
    }
}

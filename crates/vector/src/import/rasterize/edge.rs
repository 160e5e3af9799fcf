//! Edges on a grid of parts of cells, about which all is decided exactly.
//!
//! Points that are asked for are centres of cells, moved a little: up by less than right, and by less than anything that there is. So no
//! edge ever passes through one, and of two polygons on both sides of an edge exactly one has it inside (simulation of simplicity,
//! Edelsbrunner and Muecke, 1990).

use std::cmp::Ordering;

/// Parts of a cell along an axis: corners are rounded to whole numbers of them.
pub(super) const PARTS: i64 = 1 << 16;

/// The farthest a corner may lie from the tree's corner, in cells: products of three such differences are less than 2^127.
pub(super) const MAX_CELLS: f64 = (1u64 << 44) as f64;

/// A point in parts of cells.
pub(super) type Point = [i64; 2];

/// From one corner to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Edge {
    pub(super) a: Point,
    pub(super) b: Point,
}

/// The centre of a cell along an axis.
#[inline]
pub(super) fn centre(cell: i64) -> i64 {
    cell * PARTS + PARTS / 2
}

/// The sign of `a * b - c * d`, exactly; of numbers less than 2^62.
#[inline]
fn compare_products([a, b]: [i64; 2], [c, d]: [i64; 2]) -> Ordering {
    let (one, other) = (a as f64 * b as f64, c as f64 * d as f64);
    // (Each factor and each product is off by 2^-53 of itself at most.)
    const ROUNDING: f64 = 8.0 * f64::EPSILON;
    let difference = one - other;
    if difference.abs() > ROUNDING * (one.abs() + other.abs()) {
        return if difference > 0.0 { Ordering::Greater } else { Ordering::Less };
    }
    (i128::from(a) * i128::from(b)).cmp(&(i128::from(c) * i128::from(d)))
}

/// The product of two numbers: its upper and its lower 128 bits.
fn wide_product(a: u128, b: u128) -> (u128, u128) {
    const LOW: u128 = u64::MAX as u128;
    let (a, b) = ([a & LOW, a >> 64], [b & LOW, b >> 64]);
    let low = a[0] * b[0];
    let middle = a[1] * b[0] + (low >> 64);
    let other = a[0] * b[1] + (middle & LOW);
    (a[1] * b[1] + (middle >> 64) + (other >> 64), other << 64 | low & LOW)
}

impl Edge {
    /// Least and greatest coordinate along an axis.
    #[inline]
    pub(super) fn range(&self, axis: usize) -> [i64; 2] {
        let (a, b) = (self.a[axis], self.b[axis]);
        [a.min(b), a.max(b)]
    }

    /// The edge with the end first that is lower along an axis.
    #[inline]
    pub(super) fn rising(&self, axis: usize) -> Edge {
        if self.a[axis] <= self.b[axis] { *self } else { Edge { a: self.b, b: self.a } }
    }

    /// Whether the edge passes the row of a point: what is at its height counts as below it.
    #[inline]
    pub(super) fn passes(&self, axis: usize, at: i64) -> bool {
        (self.a[axis] > at) != (self.b[axis] > at)
    }

    /// Whether an edge that passes a point's row does so on the right of the point.
    #[inline]
    pub(super) fn is_right_of(&self, [x, y]: Point) -> bool {
        let Edge { a, b } = self.rising(1);
        compare_products([y - a[1], b[0] - a[0]], [x - a[0], b[1] - a[1]]) == Ordering::Greater
    }

    /// Whether an edge that passes a point's column does so above the point.
    #[inline]
    pub(super) fn is_above(&self, [x, y]: Point) -> bool {
        let Edge { a, b } = self.rising(0);
        match compare_products([x - a[0], b[1] - a[1]], [y - a[1], b[0] - a[0]]) {
            Ordering::Equal => b[1] > a[1],
            other => other == Ordering::Greater,
        }
    }

    /// The edge's part in the winding number of a point: it counts on the right of it.
    pub(super) fn winding(&self, point: Point) -> i32 {
        match self.passes(1, point[1]) && self.is_right_of(point) {
            true => self.direction(1),
            false => 0,
        }
    }

    /// 1 if the edge leads to greater coordinates along an axis, -1 if to lesser ones.
    #[inline]
    pub(super) fn direction(&self, axis: usize) -> i32 {
        if self.b[axis] > self.a[axis] { 1 } else { -1 }
    }

    /// The change of the winding number on the way from a point to another one on the right of it.
    #[inline]
    pub(super) fn on_the_way_right(&self, from: Point, to: i64) -> i32 {
        let is_met = self.passes(1, from[1]) && self.is_right_of(from) && !self.is_right_of([to, from[1]]);
        if is_met { -self.direction(1) } else { 0 }
    }

    /// The change of the winding number on the way from a point to another one above it.
    #[inline]
    pub(super) fn on_the_way_up(&self, from: Point, to: i64) -> i32 {
        let is_met = self.passes(0, from[0]) && self.is_above(from) && !self.is_above([from[0], to]);
        if is_met { self.direction(0) } else { 0 }
    }

    /// Whether both coordinates grow along the edge, in one of its directions.
    pub(super) fn leads_right_and_up(&self) -> bool {
        let Edge { a, b } = self.rising(1);
        a[1] < b[1] && a[0] < b[0]
    }

    /// Whether the edge may meet a box, its sides included: never wrongly no.
    pub(super) fn may_meet(&self, low: Point, high: Point) -> bool {
        for axis in 0..2 {
            let [least, most] = self.range(axis);
            if most < low[axis] || least > high[axis] {
                return false;
            }
        }
        // The box's corners lie on both sides of the edge's line, or on it.
        let (dx, dy) = (self.b[0] - self.a[0], self.b[1] - self.a[1]);
        let side = |x: i64, y: i64| compare_products([dx, y - self.a[1]], [dy, x - self.a[0]]);
        let first = side(low[0], low[1]);
        let others = [side(high[0], low[1]), side(low[0], high[1]), side(high[0], high[1])];
        first == Ordering::Equal || others.iter().any(|other| *other != first)
    }

    /// Whether a point is no farther from the edge than a radius, which is less than 2^60.
    pub(super) fn is_within(&self, radius: i64, [x, y]: Point) -> bool {
        let Edge { a, b } = self;
        let (dx, dy, px, py) = (b[0] - a[0], b[1] - a[1], x - a[0], y - a[1]);
        let product = |a: i64, b: i64| i128::from(a) * i128::from(b);
        let squared = product(radius, radius);
        let length = product(dx, dx) + product(dy, dy);
        // How far along the edge the point lies, in parts of its squared length.
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

    /// The first of some columns whose centre is not left of where the edge passes a row, which it does; columns are counted from
    /// one whose centre is given.
    #[inline]
    pub(super) fn column(&self, first: Point, columns: i64) -> i64 {
        let Edge { a, b } = self.rising(1);
        let slope = (b[0] - a[0]) as f64 / (b[1] - a[1]) as f64;
        let at = (a[0] - first[0]) as f64 + (first[1] - a[1]) as f64 * slope;
        let about = (at / PARTS as f64).ceil().clamp(0.0, columns as f64);
        let mut column = about as i64;
        // (What rounding may have done is undone.)
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

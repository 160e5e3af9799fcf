//! Exact predicates on points, edges and cells.

use num_bigint::BigInt;
use num_integer::Integer;
use robust::{Coord, orient2d};

use crate::grid::cell_of;

/// A point, in units of cells.
pub(crate) type Point = [f64; 2];

/// A cell, given by its centre.
pub(crate) type Cell = [i64; 2];

/// Side of the line from `a` to `b` on which a point lies: 1 on the left, -1 on the right, 0 on it
/// (J. Shewchuk, *Adaptive precision floating-point arithmetic and fast robust geometric
/// predicates*, 1997).
#[inline]
pub(crate) fn side(a: Point, b: Point, point: Point) -> i32 {
    let coord = |[x, y]: Point| Coord { x, y };
    let turn = orient2d(coord(a), coord(b), coord(point));
    i32::from(turn > 0.0) - i32::from(turn < 0.0)
}

/// Side of the line from `a` to `b` on which a cell centre lies, as in [`side`].
#[inline]
pub(crate) fn turn(a: Cell, b: Cell, point: Cell) -> i32 {
    let [ux, uy] = [b[0] - a[0], b[1] - a[1]];
    let [vx, vy] = [point[0] - a[0], point[1] - a[1]];
    let (left, right) = (ux as f64 * vy as f64, uy as f64 * vx as f64);
    let difference = left - right;
    // (Each product has at most three rounding errors.)
    if difference.abs() > (left.abs() + right.abs()) * 8.0 * f64::EPSILON {
        return if difference > 0.0 { 1 } else { -1 };
    }
    let exact = i128::from(ux) * i128::from(vy) - i128::from(uy) * i128::from(vx);
    exact.signum() as i32
}

/// Whether two edges cross in a point that is not an end of either.
pub(crate) fn do_cross([p, q]: [Point; 2], [r, s]: [Point; 2]) -> bool {
    side(r, s, p) * side(r, s, q) < 0 && side(p, q, r) * side(p, q, s) < 0
}

/// Returns the cell of the point in which two crossing edges cross.
pub(crate) fn crossing_cell(one: [Point; 2], other: [Point; 2]) -> Cell {
    near_crossing(one, other).unwrap_or_else(|| exact_crossing(one, other))
}

/// Returns the cell of a crossing if double precision decides it.
fn near_crossing([p, q]: [Point; 2], [r, s]: [Point; 2]) -> Option<Cell> {
    let determinant = |point: Point| {
        let (left, right) = ((s[0] - r[0]) * (point[1] - r[1]), (s[1] - r[1]) * (point[0] - r[0]));
        // The value and its error bound: differences and products are rounded.
        (left - right, (left.abs() + right.abs()) * 4.0 * f64::EPSILON)
    };
    let ((first, first_error), (second, second_error)) = (determinant(p), determinant(q));
    let across = first - second;
    let share = first / across;
    // (The errors of both determinants, relative to the denominator, and the rounding of the sum
    // and the quotient.)
    let share_error = 2.0 * (first_error.max(second_error) / across.abs() + 2.0 * f64::EPSILON);
    let mut cell = [0; 2];
    for axis in 0..2 {
        let along = q[axis] - p[axis];
        let at = p[axis] + share * along;
        let error = share_error * along.abs() + 4.0 * f64::EPSILON * (p[axis].abs() + along.abs());
        let from_border = (at - at.floor() - 0.5).abs();
        // (Written so that NaN fails, too.)
        if !(error < 0.25 && from_border > error) {
            return None;
        }
        cell[axis] = cell_of(at);
    }
    Some(cell)
}

/// Returns the cell of a crossing, computed with integers of arbitrary size.
fn exact_crossing([p, q]: [Point; 2], [r, s]: [Point; 2]) -> Cell {
    let numbers = [p, q, r, s].into_iter().flatten().map(parts_of);
    let bits = numbers.map(|(_, exponent)| -exponent).fold(1, i32::max);
    let whole = |point: Point| {
        point.map(|number| {
            let (mantissa, exponent) = parts_of(number);
            BigInt::from(mantissa) << (exponent + bits)
        })
    };
    let [p, q, r, s] = [p, q, r, s].map(whole);
    let determinant =
        |point: &[BigInt; 2]| (&s[0] - &r[0]) * (&point[1] - &r[1]) - (&s[1] - &r[1]) * (&point[0] - &r[0]);
    let (first, second) = (determinant(&p), determinant(&q));
    let across = &first - &second;
    std::array::from_fn(|axis| {
        // The crossing is at `above / across` units of 2^-bits. Adding half a cell before the floor
        // division rounds to the nearest cell.
        let above = &first * &q[axis] - &second * &p[axis];
        let cell = (above + (&across << (bits - 1))).div_floor(&(&across << bits));
        // (The crossing lies between the ends, whose cell numbers fit.)
        i64::try_from(cell).unwrap_or_default()
    })
}

/// Splits a number into an odd integer mantissa (0 for zero) and a binary exponent.
fn parts_of(number: f64) -> (i64, i32) {
    let bits = number.to_bits();
    let exponent = ((bits >> 52) & 0x7ff) as i32;
    let fraction = (bits & ((1 << 52) - 1)) as i64;
    let mantissa = if exponent == 0 { fraction } else { fraction | 1 << 52 };
    if mantissa == 0 {
        return (0, 0);
    }
    // (Without trailing zero bits, which would make the big integers longer.)
    let zeros = mantissa.trailing_zeros();
    let signed = if number < 0.0 { -(mantissa >> zeros) } else { mantissa >> zeros };
    (signed, exponent.max(1) - 1075 + zeros as i32)
}

/// Whether an edge passes through a cell. The cell is a half-open square: its left and lower sides
/// belong to it, without their right and upper ends.
pub(crate) fn passes([a, b]: [Point; 2], [x, y]: Cell) -> bool {
    let ([x, y], half) = ([x as f64, y as f64], 0.5);
    let (left, right, lower, upper) = (x - half, x + half, y - half, y + half);
    // The edge runs from left to right; a vertical edge runs upwards.
    let (a, b) = if a <= b { (a, b) } else { (b, a) };
    if a[0] >= right || b[0] < left || a[1].min(b[1]) >= upper || a[1].max(b[1]) < lower {
        return false;
    }
    if a[0] == b[0] || a[1] == b[1] {
        return true;
    }
    let rises = a[1] < b[1];
    let corner = |at: Point| side(a, b, at);
    // If the line passes through a corner, only the lower left corner belongs to the cell. Through
    // any other corner the edge passes the cell only if it continues in the interior.
    let upper_left = corner([left, upper]);
    if upper_left == 0 {
        return !rises;
    }
    let lower_right = corner([right, lower]);
    if lower_right == 0 {
        return !rises;
    }
    let (upper_right, lower_left) = (corner([right, upper]), corner([left, lower]));
    if upper_right == 0 || lower_left == 0 {
        return rises || lower_left == 0;
    }
    // The line separates corners of the cell. (The edge is long enough, because its bounding box
    // and the cell share more than a corner.)
    !(upper_left == lower_right && upper_right == lower_left && upper_left == upper_right)
}

//! Crossings of regular lattice lines with triangles: exact, in integers, with ties decided by
//! simulated perturbation (`perturbation.rs`), as in [`crossing`](super::crossing).
//!
//! Winding numbers are needed at all lattice points, so many lines are tested against one triangle.
//! Projected along the lines, the side functions of its edges are linear over the lattice, and
//! change by a constant per step. They fit into 64 bits, which determines
//! [`SOLID_BITS`](super::bounds::SOLID_BITS).

use super::bounds::LATTICE_ROUNDING;
use super::crossing::{edge_gradient, moved_side};
use super::normal::triangle_normal;
use super::perturbation::sign_or_first;
use super::vector::{ascending_others, dot, subtract};

/// A regular lattice of points in the cells: `2^per_cell` along each axis of a cell.
#[derive(Clone, Copy, Debug)]
pub struct Lattice {
    /// Points along each axis of a cell, as powers of two.
    pub per_cell: [u8; 3],
    /// Grid units between points along each axis.
    pub step: [i32; 3],
}

impl Lattice {
    /// Creates a lattice of `2^per_cell` points along each axis of cells that are `2^fraction` grid
    /// units wide.
    pub fn new(per_cell: [u8; 3], fraction: u8) -> Lattice {
        Lattice { per_cell, step: per_cell.map(|bits| 1 << (fraction - bits)) }
    }

    /// Returns the first lattice point of the box that begins at a grid point.
    #[inline]
    pub fn first(&self, min: [i32; 3]) -> [i32; 3] {
        std::array::from_fn(|axis| min[axis] + self.step[axis] / 2)
    }
}

/// A triangle projected along the axis `D`, prepared for many lines.
pub struct Projected<const D: usize> {
    corners: [[i32; 3]; 3],
    normal: [i64; 3],
    /// Sign of the normal along `D`: whether going up the axis leaves (1) or enters (-1) the body.
    sign: i32,
}

impl<const D: usize> Projected<D> {
    /// Projects a triangle, or returns `None` if it is seen edge-on: no line in general position
    /// along the axis meets it.
    #[inline]
    pub fn new(corners: &[[i32; 3]; 3]) -> Option<Self> {
        let normal = triangle_normal(corners);
        let sign = normal[D].signum() as i32;
        (sign != 0).then_some(Projected { corners: *corners, normal, sign })
    }

    /// Returns the change of the winding number along a line that goes up the axis through the
    /// triangle: 1 or -1.
    #[inline]
    pub fn change(&self) -> i32 {
        -self.sign
    }

    /// Returns the half-plane on the inner side of an edge, projected along the axis: its value at
    /// a point and its increments along the other two axes. A point is inside if the value is not
    /// negative.
    #[inline]
    fn half_plane(&self, edge: usize, at: [i32; 3]) -> (i64, i64, i64) {
        let [u, v] = ascending_others(D);
        let (a, b) = (self.corners[edge], self.corners[(edge + 1) % 3]);
        // Seen along y, x and z are exchanged.
        let turn = i64::from(if D == 1 { -self.sign } else { self.sign });
        let [along_u, along_v] = edge_gradient(a, b, [u, v]).map(|along| turn * along);
        let value =
            along_u * (i64::from(at[u]) - i64::from(a[u])) + along_v * (i64::from(at[v]) - i64::from(a[v]));
        let on_edge_is_inside = sign_or_first(0, [along_u, along_v]) > 0;
        // Values are integers: subtracting 1 makes an excluded edge negative and changes no other
        // sign.
        (value - i64::from(!on_edge_is_inside), along_u, along_v)
    }

    /// Returns the minimum coordinate along an axis.
    #[inline]
    fn min(&self, axis: usize) -> i32 {
        let [a, b, c] = &self.corners;
        a[axis].min(b[axis]).min(c[axis])
    }

    /// Returns the maximum coordinate along an axis.
    #[inline]
    fn max(&self, axis: usize) -> i32 {
        let [a, b, c] = &self.corners;
        a[axis].max(b[axis]).max(c[axis])
    }

    /// Returns whether the line through a point meets the triangle.
    #[inline]
    pub fn is_met(&self, at: [i32; 3]) -> bool {
        let [u, v] = ascending_others(D);
        self.min(u) <= at[u]
            && at[u] <= self.max(u)
            && self.min(v) <= at[v]
            && at[v] <= self.max(v)
            && (0..3).all(|edge| self.half_plane(edge, at).0 >= 0)
    }

    /// Returns the signed distance of a point from the plane, times the normal's length.
    #[inline]
    fn height(&self, at: [i32; 3]) -> i128 {
        let along = subtract(at.map(i64::from), self.corners[0].map(i64::from));
        dot(self.normal.map(i128::from), along.map(i128::from))
    }

    /// Returns whether a point is beyond the plane, going up the axis.
    #[inline]
    pub fn is_beyond(&self, at: [i32; 3]) -> bool {
        self.is_beyond_by(self.height(at).signum() as i32)
    }

    /// Returns whether the perturbed point is beyond the plane, going up the axis, from the side of
    /// the point itself.
    #[inline]
    fn is_beyond_by(&self, side: i32) -> bool {
        moved_side(side, self.normal) == self.sign
    }

    /// Returns the distance from a point up the axis to the plane, in grid units: used for sorting.
    #[inline]
    pub fn height_over(&self, at: [i32; 3]) -> f64 {
        let height = self.height(at);
        -height as f64 / self.normal[D] as f64
    }

    /// Visits the lattice lines that meet the triangle; the lattice begins at `first`. Passes the
    /// line's indices along the other two axes, of `count` lines each, and the number of lattice
    /// points before the triangle, from 0 to `points`.
    #[inline]
    pub fn rows(
        &self,
        lattice: &Lattice,
        first: [i32; 3],
        count: [usize; 2],
        points: usize,
        mut each: impl FnMut(usize, usize, usize),
    ) {
        let [u, v] = ascending_others(D);
        let range = |axis: usize, count: usize| {
            let step = i64::from(lattice.step[axis]);
            let from = (self.min(axis) as i64 - first[axis] as i64 + step - 1).div_euclid(step).max(0);
            let to = (self.max(axis) as i64 - first[axis] as i64).div_euclid(step).min(count as i64 - 1);
            from..to + 1
        };
        let (along_u, along_v) = (range(u, count[0]), range(v, count[1]));
        if along_u.is_empty() || along_v.is_empty() {
            return;
        }
        let mut start = first;
        start[u] += along_u.start as i32 * lattice.step[u];
        start[v] += along_v.start as i32 * lattice.step[v];
        let edges: [_; 3] = std::array::from_fn(|edge| self.half_plane(edge, start));
        let [mut a, mut b, mut c] = edges.map(|(value, ..)| value);
        let step_u = edges.map(|(_, along, _)| along * lattice.step[u] as i64);
        let step_v = edges.map(|(.., along)| along * lattice.step[v] as i64);
        let positions = Positions::new(self, lattice, first, start);
        for j in along_v.clone() {
            let (mut a_here, mut b_here, mut c_here) = (a, b, c);
            let row = (j - along_v.start) as f64;
            for i in along_u.clone() {
                // The sign bit of the bitwise or is set if any value is negative: one comparison
                // for three half-planes.
                if a_here | b_here | c_here >= 0 {
                    let before = positions.before((i - along_u.start) as f64, row, || {
                        let mut at = first;
                        at[u] += i as i32 * lattice.step[u];
                        at[v] += j as i32 * lattice.step[v];
                        self.points_before(lattice, at)
                    });
                    each(i as usize, j as usize, before.clamp(0, points as i64) as usize);
                }
                a_here += step_u[0];
                b_here += step_u[1];
                c_here += step_u[2];
            }
            a += step_v[0];
            b += step_v[1];
            c += step_v[2];
        }
    }

    /// Returns the exact number of a line's points before the plane, where the line begins at `at`.
    /// It is negative if even points before the beginning are beyond.
    #[cold]
    fn points_before(&self, lattice: &Lattice, at: [i32; 3]) -> i64 {
        let height = self.height(at);
        // The line meets the plane `-height / normal` grid units up the axis.
        let over = i128::from(self.normal[D].unsigned_abs()) * i128::from(lattice.step[D]);
        let up = -height * i128::from(self.sign);
        let whole = up.div_euclid(over);
        // Point `i` is `i * over` up the axis: points 0 to `whole` are before the plane or on it. A
        // point on the plane belongs to the side to which the perturbation moves it.
        let is_on_point = whole * over == up;
        let before = if is_on_point && self.is_beyond_by(0) { whole } else { whole + 1 };
        before.clamp(i128::from(i64::MIN), i128::from(i64::MAX)) as i64
    }
}

/// Positions at which lines meet a triangle's plane, in lattice steps up the axis, in floating
/// point with an error bound.
struct Positions {
    start: f64,
    along_u: f64,
    along_v: f64,
    /// Bound of the rounding error of a position, in lattice steps.
    error: f64,
}

impl Positions {
    fn new<const D: usize>(
        projected: &Projected<D>,
        lattice: &Lattice,
        first: [i32; 3],
        start: [i32; 3],
    ) -> Positions {
        let [u, v] = ascending_others(D);
        let from = projected.corners[0];
        let step = f64::from(lattice.step[D]);
        let normal = projected.normal.map(|n| n as f64);
        let (slope_u, slope_v) = (-normal[u] / normal[D] / step, -normal[v] / normal[D] / step);
        let (du, dv) = (f64::from(start[u]) - f64::from(from[u]), f64::from(start[v]) - f64::from(from[v]));
        let position = (f64::from(from[D]) - f64::from(first[D])) / step + slope_u * du + slope_v * dv;
        // Within the triangle's box, no term is larger than its counterpart in this sum.
        let width = |axis: usize| f64::from(projected.max(axis)) - f64::from(projected.min(axis));
        let height = (f64::from(from[D]).abs() + f64::from(first[D]).abs()) / step;
        let size = slope_u.abs() * width(u) + slope_v.abs() * width(v) + height + 1.0;
        Positions {
            start: position,
            along_u: slope_u * f64::from(lattice.step[u]),
            along_v: slope_v * f64::from(lattice.step[v]),
            error: size * LATTICE_ROUNDING,
        }
    }

    /// Returns the number of lattice points before the plane; calls `exact` if floating point
    /// cannot decide.
    #[inline]
    fn before(&self, i: f64, j: f64, exact: impl FnOnce() -> i64) -> i64 {
        let position = self.start + i * self.along_u + j * self.along_v;
        let up = position.ceil();
        let above = up - position;
        // (Written so that a NaN calls `exact`.)
        if above > self.error && 1.0 - above > self.error { up as i64 } else { exact() }
    }
}

#[cfg(test)]
mod tests {
    use super::super::bounds::SOLID_BITS;
    use super::super::crossing::{FinePoint, Outline};
    use super::*;

    /// Pseudo-random numbers below a bound.
    fn random(seed: u64) -> impl FnMut(i64) -> i64 {
        let mut state = seed;
        move |below| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            ((state >> 24) as i64).rem_euclid(below)
        }
    }

    /// Triangles of small coordinates, many of which touch, and triangles of extreme coordinates;
    /// and some points for each.
    fn cases() -> impl Iterator<Item = ([[i32; 3]; 3], Vec<[i32; 3]>)> {
        let mut number = random(1);
        (0..6_000).map(move |round| {
            let [low, high] = [[0, 4], [-(1i64 << SOLID_BITS), 2 << SOLID_BITS]][round % 2];
            let mut place = |corners: &[[i32; 3]]| -> [i32; 3] {
                std::array::from_fn(|axis| match number(5) {
                    0 => low as i32,
                    1 => high as i32,
                    2 if !corners.is_empty() => corners[number(corners.len() as i64) as usize][axis],
                    _ => (low + number(high - low + 1)) as i32,
                })
            };
            let corners = [0; 3].map(|_| place(&[]));
            let points = (0..8).map(|_| place(&corners)).chain(corners);
            // (A point in the middle of an edge.)
            let middle = [0, 1, 2]
                .map(|axis| ((i64::from(corners[0][axis]) + i64::from(corners[1][axis])) / 2) as i32);
            (corners, points.chain([middle]).collect())
        })
    }

    fn agrees<const D: usize>(corners: &[[i32; 3]; 3], from: [i32; 3], to: i32) -> i32 {
        let outline = Outline { points: corners, ring_ends: &[3], normal: triangle_normal(corners) };
        let point = FinePoint { at: from.map(i64::from), bits: 0 };
        let expected = outline.change_along(D, &point, i64::from(to));
        let mut there = from;
        there[D] = to;
        let found =
            Projected::<D>::new(corners).filter(|projected| projected.is_met(from)).map_or(0, |projected| {
                let passes = projected.is_beyond(from) != projected.is_beyond(there);
                i32::from(passes) * if to > from[D] { projected.change() } else { -projected.change() }
            });
        assert_eq!(found, expected, "{corners:?} {from:?} along {D} to {to}");
        expected
    }

    /// Crossings in 64 bits equal those of polygons in 128, also on edges and vertices, and for the
    /// largest coordinates.
    #[test]
    fn crossings_are_those_of_polygons() {
        let mut passed = 0;
        for (corners, points) in cases() {
            for pair in points.windows(2) {
                let [from, to] = [pair[0], pair[1]];
                let changes = [
                    agrees::<0>(&corners, from, to[0]),
                    agrees::<1>(&corners, from, to[1]),
                    agrees::<2>(&corners, from, to[2]),
                ];
                passed += changes.into_iter().filter(|change| *change != 0).count();
            }
        }
        assert!(passed > 5_000, "{passed}");
    }

    fn check_rows<const D: usize>(
        corners: &[[i32; 3]; 3],
        lattice: &Lattice,
        first: [i32; 3],
        side: usize,
    ) -> usize {
        let Some(projected) = Projected::<D>::new(corners) else { return 0 };
        let [u, v] = ascending_others(D);
        let mut found = Vec::new();
        projected.rows(lattice, first, [side; 2], side, |i, j, before| found.push((j, i, before)));
        let mut expected = Vec::new();
        for (j, i) in (0..side).flat_map(|j| (0..side).map(move |i| (j, i))) {
            let mut at = first;
            at[u] += i as i32 * lattice.step[u];
            at[v] += j as i32 * lattice.step[v];
            if projected.is_met(at) {
                let point = |place: usize| {
                    let mut at = at;
                    at[D] += place as i32 * lattice.step[D];
                    at
                };
                expected.push((j, i, (0..side).filter(|place| !projected.is_beyond(point(*place))).count()));
            }
        }
        assert_eq!(found, expected, "{corners:?} {lattice:?} {first:?}");
        found.len()
    }

    /// Rows of a lattice, computed incrementally and by doubles, equal the results of single
    /// points.
    #[test]
    fn rows_are_those_of_points() {
        let mut met = 0;
        for (number, (corners, _)) in cases().enumerate() {
            let is_large = number % 2 == 1;
            let step = if is_large { 1 << (SOLID_BITS - 2) } else { 1 };
            let (lattice, first) = (
                Lattice { per_cell: [0; 3], step: [step; 3] },
                if is_large { -(1 << SOLID_BITS) } else { 0 },
            );
            let side = if is_large { 12 } else { 5 };
            // (At the vertices' coordinates, and next to them.)
            let first = [0, 1, 2].map(|axis| first + (number / 2 % 3 == 1) as i32 * axis);
            met += check_rows::<0>(&corners, &lattice, first, side);
            met += check_rows::<1>(&corners, &lattice, first, side);
            met += check_rows::<2>(&corners, &lattice, first, side);
        }
        assert!(met > 10_000, "{met}");
    }
}

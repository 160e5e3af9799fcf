//! Crossings of lines along an axis with triangles: exact, by integer arithmetic.
//!
//! Winding numbers are asked for at the points of a lattice. Lines between lattice points may pass through
//! edges and vertices, and lattice points may lie on triangles; to have an answer that is right for all
//! triangles together, the whole lattice is thought of as moved by an infinitesimal vector, by far the most
//! along x and by far the least along z (the simulation of simplicity of Edelsbrunner and Muecke, 1990). A
//! tie is then decided by the first derivative that is not zero, and every line meets a closed surface as a
//! line in general position does.

use super::grid::Triangle;

/// A regular lattice of points in the cells: `per_cell` along each axis of a cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lattice {
    /// Points along each axis of a cell, as powers of two.
    pub(super) per_cell: [u8; 3],
    /// Grid steps between points along each axis.
    pub(super) step: [i32; 3],
}

impl Lattice {
    /// A lattice of `2^per_cell` points along each axis of cells that are `2^fraction` grid steps wide.
    pub(super) fn new(per_cell: [u8; 3], fraction: u8) -> Lattice {
        Lattice { per_cell, step: per_cell.map(|bits| 1 << (fraction - bits)) }
    }

    /// The first lattice point of the box that begins at a grid point.
    pub(super) fn first(&self, min: [i32; 3]) -> [i32; 3] {
        std::array::from_fn(|axis| min[axis] + self.step[axis] / 2)
    }
}

/// The other two axes, in order.
pub(super) const fn others(axis: usize) -> (usize, usize) {
    match axis {
        0 => (1, 2),
        1 => (0, 2),
        _ => (0, 1),
    }
}

/// A triangle projected along the axis `D`, prepared for many lines.
pub(super) struct Projected<const D: usize> {
    triangle: Triangle,
    normal: [i64; 3],
    /// By its normal, whether going up the axis leaves (1) or enters (-1) what is behind.
    sign: i32,
}

impl<const D: usize> Projected<D> {
    /// `None` if it is seen edge-on: no line in general position along the axis meets it.
    #[inline]
    pub(super) fn new(triangle: &Triangle) -> Option<Self> {
        let normal = triangle.normal();
        let sign = normal[D].signum() as i32;
        (sign != 0).then_some(Projected { triangle: *triangle, normal, sign })
    }

    /// Change of the winding number along a line that goes up the axis through the triangle: 1 or -1.
    #[inline]
    pub(super) fn change(&self) -> i32 {
        -self.sign
    }

    /// The half-plane to the inner side of an edge, seen along the axis: its values at a point and along the
    /// other two axes. A point is inside where the value is not negative.
    #[inline]
    fn half_plane(&self, edge: usize, at: [i32; 3]) -> (i64, i64, i64) {
        let (u, v) = others(D);
        let (a, b) = (self.triangle.corners[edge], self.triangle.corners[(edge + 1) % 3]);
        // Seen along y, x and z are the other way round.
        let turn = i64::from(if D == 1 { -self.sign } else { self.sign });
        let along_u = -turn * (b[v] as i64 - a[v] as i64);
        let along_v = turn * (b[u] as i64 - a[u] as i64);
        let value = along_u * (at[u] as i64 - a[u] as i64) + along_v * (at[v] as i64 - a[v] as i64);
        // On the edge the infinitesimal step decides, along u first.
        let on_edge_is_inside = if along_u != 0 { along_u > 0 } else { along_v > 0 };
        // Values are whole: taking off 1 makes an excluded edge negative and changes no other sign.
        // Differences have 31 bits, so that two products of them and this 1 fit an `i64`.
        (value - i64::from(!on_edge_is_inside), along_u, along_v)
    }

    /// Whether the line through a point meets the triangle.
    #[inline]
    pub(super) fn is_met(&self, at: [i32; 3]) -> bool {
        let (u, v) = others(D);
        let t = &self.triangle;
        t.min(u) <= at[u]
            && at[u] <= t.max(u)
            && t.min(v) <= at[v]
            && at[v] <= t.max(v)
            && (0..3).all(|edge| self.half_plane(edge, at).0 >= 0)
    }

    /// Whether a point on the plane itself counts as beyond it, going up the axis.
    #[inline]
    fn on_plane_is_beyond(&self) -> bool {
        let first = self.normal.into_iter().find(|n| *n != 0).unwrap_or(1);
        (first > 0) == (self.sign > 0)
    }

    /// Signed distance of a point from the plane, times the normal's length.
    fn height(&self, at: [i32; 3]) -> i128 {
        let from = self.triangle.corners[0];
        let along =
            |axis: usize| i128::from(self.normal[axis]) * i128::from(at[axis] as i64 - from[axis] as i64);
        along(0) + along(1) + along(2)
    }

    /// Whether a point lies beyond the plane, going up the axis.
    pub(super) fn is_beyond(&self, at: [i32; 3]) -> bool {
        let height = self.height(at);
        if height == 0 { self.on_plane_is_beyond() } else { (height > 0) == (self.sign > 0) }
    }

    /// Distance from a point up the axis to the plane, in grid steps: to put several in order.
    pub(super) fn height_over(&self, at: [i32; 3]) -> f64 {
        let height = self.height(at);
        -height as f64 / self.normal[D] as f64
    }

    /// Hands out where lines of a lattice, which begins at `first`, pass through: the line's numbers along
    /// the other two axes, of `count` lines each, and the number of lattice points before the triangle, from
    /// 0 to `points`.
    #[inline]
    pub(super) fn rows(
        &self,
        lattice: &Lattice,
        first: [i32; 3],
        count: [usize; 2],
        points: usize,
        mut each: impl FnMut(usize, usize, usize),
    ) {
        let (u, v) = others(D);
        let t = &self.triangle;
        let range = |axis: usize, count: usize| {
            let step = i64::from(lattice.step[axis]);
            let from = (t.min(axis) as i64 - first[axis] as i64 + step - 1).div_euclid(step).max(0);
            let to = (t.max(axis) as i64 - first[axis] as i64).div_euclid(step).min(count as i64 - 1);
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
                // The sign bit of the union is that of any negative value: one comparison for three
                // half-planes.
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

    /// Number of points of the line that begins at a point that lie before the plane, exactly; negative if
    /// even points before the beginning lie beyond.
    #[cold]
    fn points_before(&self, lattice: &Lattice, at: [i32; 3]) -> i64 {
        let height = self.height(at);
        // The plane is met `-height / normal` grid steps up the axis.
        let over = i128::from(self.normal[D].unsigned_abs()) * i128::from(lattice.step[D]);
        let up = -height * i128::from(self.sign);
        let whole = up.div_euclid(over);
        // Point `i` lies `i * over` up the axis: points 0 to `whole` are before the plane or on it. The one
        // on it belongs to the side to which the infinitesimal step moves it.
        let is_on_point = whole * over == up;
        let before = if is_on_point && self.on_plane_is_beyond() { whole } else { whole + 1 };
        before.clamp(i128::from(i64::MIN), i128::from(i64::MAX)) as i64
    }
}

/// Positions at which lines meet a triangle's plane, in lattice steps up the axis, in floating point where
/// that is sure.
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
        let (u, v) = others(D);
        let from = projected.triangle.corners[0];
        let step = f64::from(lattice.step[D]);
        let normal = projected.normal.map(|n| n as f64);
        let (slope_u, slope_v) = (-normal[u] / normal[D] / step, -normal[v] / normal[D] / step);
        let (du, dv) = (f64::from(start[u]) - f64::from(from[u]), f64::from(start[v]) - f64::from(from[v]));
        let position = (f64::from(from[D]) - f64::from(first[D])) / step + slope_u * du + slope_v * dv;
        // Every term is right to a few units in the last place, and they are no larger than this on the
        // triangle's box.
        let width =
            |axis: usize| f64::from(projected.triangle.max(axis)) - f64::from(projected.triangle.min(axis));
        let height = (f64::from(from[D]).abs() + f64::from(first[D]).abs()) / step;
        let size = slope_u.abs() * width(u) + slope_v.abs() * width(v) + height + 1.0;
        Positions {
            start: position,
            along_u: slope_u * f64::from(lattice.step[u]),
            along_v: slope_v * f64::from(lattice.step[v]),
            error: size * 64.0 * f64::EPSILON,
        }
    }

    /// Lattice points before the plane, by `exact` where floating point does not tell.
    #[inline]
    fn before(&self, i: f64, j: f64, exact: impl FnOnce() -> i64) -> i64 {
        let position = self.start + i * self.along_u + j * self.along_v;
        let up = position.ceil();
        let above = up - position;
        // (Written so that a NaN is not sure.)
        if above > self.error && 1.0 - above > self.error { up as i64 } else { exact() }
    }
}

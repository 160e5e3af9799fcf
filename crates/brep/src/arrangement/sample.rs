//! Sample points inside regions of a plane, and the faces that an axis-parallel line through a
//! sample meets: exact.

use std::hash::{Hash, Hasher};

use bnum::cast::As;
use bnum::types::I1024;

use super::exact_face::ExactFace;
use super::overlay::PlaneRegion;
use super::point::{ExactPlane, ExactPoint, area, sign, turn};
use crate::exact::bounds::{ORDER_ERROR, TURN_ERROR};
use crate::exact::perturbation::sign_or_first;
use crate::exact::vector::others;

/// A point of a plane, by its two coordinates across the plane's main axis. These are homogeneous,
/// with at most 541 bits.
pub(crate) struct SamplePoint<'a> {
    pub(super) plane: &'a ExactPlane,
    /// Invariant: this is the plane's main axis, so that the normal's component along it is not 0.
    /// The line along the axis meets the plane in one point: `SamplePoint::side` and `near` divide
    /// by that component.
    pub(crate) axis: usize,
    /// Coordinates along the two other axes.
    at: [I1024; 2],
    /// Divisor of the coordinates; positive.
    weight: I1024,
    /// Copy of coordinates and weight in fewer bits, if they are below 2^68 and 2^40.
    ///
    /// Invariant: no larger numbers are stored here. So products with grid coordinates and their
    /// differences, of 27 bits each, are below 2^127. (An overflow would be a wrong side of an
    /// edge.)
    small: Option<([i128; 2], i128)>,
    /// The point, approximately.
    pub(crate) near: [f64; 3],
}

/// A sample point that is kept: with its own plane.
#[derive(Clone)]
pub(crate) struct StoredSample {
    plane: ExactPlane,
    axis: usize,
    at: [I1024; 2],
    weight: I1024,
    small: Option<([i128; 2], i128)>,
    near: [f64; 3],
}

impl StoredSample {
    pub(crate) fn point(&self) -> SamplePoint<'_> {
        let StoredSample { plane, axis, at, weight, small, near } = self;
        SamplePoint { plane, axis: *axis, at: *at, weight: *weight, small: *small, near: *near }
    }
}

impl SamplePoint<'_> {
    pub(crate) fn stored(&self) -> StoredSample {
        let SamplePoint { plane, axis, at, weight, small, near } = *self;
        StoredSample { plane: *plane, axis, at, weight, small, near }
    }

    /// Adds to a hash all that the winding numbers around the sample depend on: the point, the
    /// axis, and the plane in which the point is moved.
    pub(crate) fn hash(&self, hasher: &mut impl Hasher) {
        (self.axis, self.plane.normal, self.plane.offset).hash(hasher);
        (self.at, self.weight).hash(hasher);
    }
}

fn widen<const N: usize>(number: bnum::Int<N>) -> I1024 {
    number.as_()
}

fn small(number: i64) -> I1024 {
    number.as_()
}

impl<'a> SamplePoint<'a> {
    /// Returns the centroid of a triangle on the grid.
    pub(crate) fn of_triangle(plane: &'a ExactPlane, corners: &[[i32; 3]; 3]) -> SamplePoint<'a> {
        let axis = plane.main_axis();
        let sum = |axis: usize| corners.iter().map(|corner| i64::from(corner[axis])).sum::<i64>();
        let near = [0, 1, 2].map(|axis| sum(axis) as f64 / 3.0);
        let at = others(axis).map(&sum);
        let few = Some((at.map(i128::from), 3));
        SamplePoint { plane, axis, at: at.map(small), weight: small(3), small: few, near }
    }

    /// Returns a point inside a region. It is the centroid of the triangle at a convex vertex, if
    /// the triangle contains no other vertex. Otherwise it is the midpoint of the diagonal to the
    /// vertex that is deepest in the triangle.
    pub(crate) fn of_region(plane: &'a ExactPlane, region: &PlaneRegion) -> SamplePoint<'a> {
        let axis = plane.main_axis();
        let [u, v] = others(axis);
        let ring = &region.rings[0];
        // The minimum vertex is convex.
        let order = |a: usize, b: usize| {
            let (a, b) = (&ring[a].point, &ring[b].point);
            a.compare(b, u).then_with(|| a.compare(b, v))
        };
        let least =
            (1..ring.len()).fold(0, |best, other| if order(other, best).is_lt() { other } else { best });
        let (last, next) = (&ring[(least + ring.len() - 1) % ring.len()], &ring[(least + 1) % ring.len()]);
        let (before, after) = (&last.line, &ring[least].line);
        let [last, corner, next] = [last, &ring[least], next].map(|corner| &corner.point);
        // (The edges' planes need less work than three points.)
        let sides = (before.side(next), after.side(last));
        let is_in = |point: &ExactPoint| {
            before.side(point) == sides.0
                && after.side(point) == sides.1
                && turn(axis, [next, last, point]) > 0
        };
        // (Depths lack the factor of the point's own weight.)
        let depth = |point: &ExactPoint| area(axis, [next, last, point]);
        let mut deepest: Option<(&ExactPoint, I1024)> = None;
        let corners = region.rings.iter().flatten().map(|corner| &corner.point);
        for point in corners.filter(|point| is_in(point)) {
            let found = depth(point);
            if deepest
                .as_ref()
                .is_none_or(|(best, most)| found * widen(best.weight) > *most * widen(point.weight))
            {
                deepest = Some((point, found));
            }
        }
        match deepest {
            Some((point, _)) => SamplePoint::mean(plane, &[corner, point]),
            None => SamplePoint::near_middle(plane, [last, corner, next])
                .unwrap_or_else(|| SamplePoint::mean(plane, &[last, corner, next])),
        }
    }

    /// Returns a point with few bits near the centroid of a triangle; `None` if the triangle is too
    /// thin to be sure that the point is inside.
    fn near_middle(plane: &'a ExactPlane, corners: [&ExactPoint; 3]) -> Option<SamplePoint<'a>> {
        /// Fractions of a grid unit.
        const FINE: i64 = 1 << 20;
        let axis = plane.main_axis();
        let [u, v] = others(axis);
        let at = [u, v].map(|axis| {
            let sum: f64 = corners.iter().map(|corner| corner.near[axis]).sum();
            (sum / 3.0 * FINE as f64).round() as i64
        });
        let mut near = [0.0; 3];
        (near[u], near[v]) = (at[0] as f64 / FINE as f64, at[1] as f64 / FINE as f64);
        let normal = plane.normal.map(|part| part as f64);
        near[axis] = (plane.offset as f64 - normal[u] * near[u] - normal[v] * near[v]) / normal[axis];
        let is_left = |i: usize| {
            let (from, to) = (corners[i].near, corners[(i + 1) % 3].near);
            let along = [to[u] - from[u], to[v] - from[v]];
            let there = [near[u] - from[u], near[v] - from[v]];
            let size: f64 = along.iter().chain(&there).map(|part| part.abs()).sum();
            along[0] * there[1] - along[1] * there[0] > (size + 1.0) * TURN_ERROR
        };
        let few = Some((at.map(i128::from), i128::from(FINE)));
        let all = (0..3).all(is_left);
        all.then(|| SamplePoint { plane, axis, at: at.map(small), weight: small(FINE), small: few, near })
    }

    /// Returns the mean of some points.
    pub(crate) fn mean(plane: &'a ExactPlane, points: &[&ExactPoint]) -> SamplePoint<'a> {
        let axis = plane.main_axis();
        let count = points.len();
        let others_weight = |index: usize| {
            (0..count)
                .filter(|other| *other != index)
                .fold(small(1), |all, other| all * widen(points[other].weight))
        };
        let at = others(axis).map(|axis| {
            (0..count).fold(small(0), |sum, index| sum + widen(points[index].at[axis]) * others_weight(index))
        });
        let weight = others_weight(0) * widen(points[0].weight) * small(count as i64);
        let near =
            [0, 1, 2].map(|axis| points.iter().map(|point| point.near[axis]).sum::<f64>() / count as f64);
        let few = (weight < small(1 << 40)).then(|| (at.map(|at| at.as_()), weight.as_()));
        SamplePoint { plane, axis, at, weight, small: few, near }
    }

    /// Whether the line along the axis through the point meets a polygon, by even-odd parity. The
    /// line is moved by an infinitesimal vector to greater coordinates, far less along the second
    /// axis than along the first.
    pub(crate) fn meets(&self, points: &[[i32; 3]], ring_ends: &[usize]) -> bool {
        let mut inside = false;
        let mut start = 0;
        for &end in ring_ends {
            let ring = &points[start..end];
            start = end;
            let Some(mut a) = ring.last() else { continue };
            for b in ring {
                inside ^= self.passes(a, b);
                a = b;
            }
        }
        inside
    }

    /// Like [`SamplePoint::meets`], for a polygon with off-grid vertices.
    pub(crate) fn meets_exact(&self, face: &ExactFace) -> bool {
        face.edges().fold(false, |inside, (corner, next)| inside ^ self.passes(&corner.point, next))
    }

    /// Whether an edge crosses the ray from the point to greater first coordinates, as seen along
    /// the axis.
    // Invariant: all predicates treat the sample as moved by the same infinitesimal vector: to
    // greater first coordinates, far less to greater second ones, and within its own plane. So they
    // break ties alike: here (only a strictly greater vertex is above), in
    // `SamplePoint::is_between` and in `SamplePoint::side`. A line then meets a closed surface as a
    // line in general position does. If two predicates broke ties differently, an edge or a vertex
    // on the line would count twice or not at all.
    fn passes<P: SampledVertex>(&self, a: &P, b: &P) -> bool {
        let above_b = self.beyond(1, b) > 0;
        if (self.beyond(1, a) > 0) == above_b {
            return false;
        }
        match (self.beyond(0, a), self.beyond(0, b)) {
            (1, 1) => true,
            (-1, -1) => false,
            // If the point is to the left of an upward edge, the edge crosses at a greater
            // coordinate.
            _ => {
                let turn = a.turn(b, self);
                turn != 0 && (turn > 0) == above_b
            }
        }
    }

    /// Returns the sign of the difference of a vertex's first or second coordinate from the
    /// point's.
    fn beyond(&self, index: usize, corner: &impl SampledVertex) -> i32 {
        let axis = others(self.axis)[index];
        let difference = corner.near(axis) - self.near[axis];
        if difference.abs() > ORDER_ERROR {
            return if difference > 0.0 { 1 } else { -1 };
        }
        corner.beyond(self, index)
    }

    /// Whether the line along the axis through the point, moved as in [`SamplePoint::meets`],
    /// passes between two corners of a box in half grid units.
    pub(crate) fn is_between(&self, low: &[i64; 3], high: &[i64; 3]) -> bool {
        let axes = others(self.axis);
        // (The moved line is beyond a bound that the point is exactly at.)
        let is_beyond = |index: usize, at: i64| {
            let difference = at as f64 / 2.0 - self.near[axes[index]];
            if difference.abs() > ORDER_ERROR {
                return difference < 0.0;
            }
            match self.small {
                Some((own, weight)) => 2 * own[index] >= i128::from(at) * weight,
                None => self.at[index] + self.at[index] >= small(at) * self.weight,
            }
        };
        (0..2).all(|index| is_beyond(index, low[axes[index]]) && !is_beyond(index, high[axes[index]]))
    }

    /// Returns the side of a plane on which a point of the line lies, given by its coordinate along
    /// the axis in half grid units; 0 in the plane.
    pub(crate) fn side_at(&self, plane: &ExactPlane, half_units: i64) -> i32 {
        let mut near = self.near;
        near[self.axis] = half_units as f64 / 2.0;
        if let Some(side) = plane.side_near(near) {
            return side;
        }
        let [u, v] = others(self.axis);
        let its = |axis: usize| small(plane.normal[axis]);
        let along = its(u) * self.at[0] + its(v) * self.at[1] - widen(wide_offset(plane)) * self.weight;
        sign(&(along + along + its(self.axis) * small(half_units) * self.weight))
    }

    /// Returns the side of a plane on which the point lies. If it is in the plane, the side to
    /// which it moves, as in [`SamplePoint::meets`], within its own plane. 0 if the planes are
    /// equal.
    pub(crate) fn side(&self, plane: &ExactPlane) -> i32 {
        if let Some(side) = plane.side_near(self.near) {
            return side;
        }
        if self.plane.is(plane) {
            return 0;
        }
        let [u, v] = others(self.axis);
        let own = |axis: usize| small(self.plane.normal[axis]);
        let its = |axis: usize| small(plane.normal[axis]);
        let main = self.axis;
        // The coordinate along the axis is `rest / (own(main) weight)`.
        let rest = widen(wide_offset(self.plane)) * self.weight - own(u) * self.at[0] - own(v) * self.at[1];
        let height = own(main)
            * (its(u) * self.at[0] + its(v) * self.at[1] - widen(wide_offset(plane)) * self.weight)
            + its(main) * rest;
        let up = self.plane.normal[main].signum() as i32;
        let moved = |axis: usize| sign(&(its(axis) * own(main) - its(main) * own(axis)));
        sign_or_first(sign(&height), [moved(u), moved(v)]) * up
    }
}

/// A vertex of a polygon, as seen from a sample.
trait SampledVertex {
    fn near(&self, axis: usize) -> f64;

    /// Returns the sign of the difference of a coordinate from the sample's.
    fn beyond(&self, sample: &SamplePoint<'_>, index: usize) -> i32;

    /// Whether the sample is to the left (1) of the edge to another vertex, to the right (-1), or
    /// on its line.
    fn turn(&self, to: &Self, sample: &SamplePoint<'_>) -> i32;
}

impl SampledVertex for [i32; 3] {
    fn near(&self, axis: usize) -> f64 {
        self[axis].into()
    }

    fn beyond(&self, sample: &SamplePoint<'_>, index: usize) -> i32 {
        let coordinate = self[others(sample.axis)[index]];
        match sample.small {
            Some((at, weight)) => (i128::from(coordinate) * weight - at[index]).signum() as i32,
            None => sign(&(small(coordinate.into()) * sample.weight - sample.at[index])),
        }
    }

    fn turn(&self, b: &[i32; 3], sample: &SamplePoint<'_>) -> i32 {
        let [u, v] = others(sample.axis);
        let along = [u, v].map(|axis| i64::from(b[axis]) - i64::from(self[axis]));
        let to = [u, v].map(|axis| sample.near[axis] - f64::from(self[axis]));
        let area = along[0] as f64 * to[1] - along[1] as f64 * to[0];
        let size = along[0].abs() + along[1].abs();
        if area.abs() > size as f64 * TURN_ERROR {
            return if area > 0.0 { 1 } else { -1 };
        }
        if let Some((at, weight)) = sample.small {
            let to = |index: usize| at[index] - i128::from(self[[u, v][index]]) * weight;
            return (i128::from(along[0]) * to(1) - i128::from(along[1]) * to(0)).signum() as i32;
        }
        let to = |index: usize| sample.at[index] - small(self[[u, v][index]].into()) * sample.weight;
        sign(&(small(along[0]) * to(1) - small(along[1]) * to(0)))
    }
}

impl SampledVertex for ExactPoint {
    fn near(&self, axis: usize) -> f64 {
        self.near[axis]
    }

    fn beyond(&self, sample: &SamplePoint<'_>, index: usize) -> i32 {
        let at = widen(self.at[others(sample.axis)[index]]);
        sign(&(at * sample.weight - sample.at[index] * widen(self.weight)))
    }

    fn turn(&self, b: &ExactPoint, sample: &SamplePoint<'_>) -> i32 {
        let [u, v] = others(sample.axis);
        let along = [u, v].map(|axis| b.near[axis] - self.near[axis]);
        let to = [u, v].map(|axis| sample.near[axis] - self.near[axis]);
        let area = along[0] * to[1] - along[1] * to[0];
        let size = along[0].abs() + along[1].abs() + to[0].abs() + to[1].abs();
        if area.abs() > (size + 1.0) * TURN_ERROR {
            return if area > 0.0 { 1 } else { -1 };
        }
        // (Vertices have 197 and 171 bits, the sample 541 and 515: 912 in all.)
        let minor = |p: [I1024; 2], q: [I1024; 2]| p[0] * q[1] - p[1] * q[0];
        let [from, to] = [self, b].map(|point| [u, v].map(|axis| widen(point.at[axis])));
        let [from_weight, to_weight] = [self, b].map(|point| widen(point.weight));
        let sum = minor(from, to) * sample.weight
            + minor(to, sample.at) * from_weight
            + minor(sample.at, from) * to_weight;
        sign(&sum)
    }
}

fn wide_offset(plane: &ExactPlane) -> bnum::types::I256 {
    super::point::wide(plane.offset)
}

//! Points with rational coordinates, and planes through grid points: exact, with floating-point
//! filters.
//!
//! Invariant: every plane is the plane of an input face, or is parallel to an axis and contains two
//! grid points. No plane is computed from computed points: a region of a face keeps the face's
//! plane, and its new edges keep the planes of the faces that made them, over any number of
//! operations. So normals have at most 56 bits and offsets 84. The intersection point of three
//! planes has homogeneous coordinates of at most 197 bits and a weight of at most 171. The test on
//! which side of a plane it lies takes at most 255 bits ([`bounds`](crate::exact::bounds) derives
//! them). A plane through computed points would have some 600 bits: numbers would overflow, and
//! signs would be wrong.

use std::cmp::Ordering;

use bnum::cast::As;
use bnum::types::{I256, I512, I1024};

use crate::exact::bounds::{ORDER_ERROR, SIDE_ERROR, TURN_ERROR};
use crate::exact::vector::{self, dot, main_axis, others};

/// A plane through grid points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExactPlane {
    /// Normal, which points to the front.
    pub normal: [i64; 3],
    /// Dot product of the normal with any point of the plane.
    pub offset: i128,
}

impl ExactPlane {
    /// Returns the plane through a point with a normal.
    pub fn through(base: [i32; 3], normal: [i64; 3]) -> ExactPlane {
        ExactPlane { normal, offset: dot(normal.map(i128::from), base.map(i128::from)) }
    }

    /// Returns the plane through two points that is parallel to an axis.
    pub fn along(axis: usize, from: [i32; 3], to: [i32; 3]) -> ExactPlane {
        let [u, v] = others(axis);
        let mut normal = [0; 3];
        normal[u] = i64::from(from[v]) - i64::from(to[v]);
        normal[v] = i64::from(to[u]) - i64::from(from[u]);
        ExactPlane::through(from, normal)
    }

    /// Returns the signed height of a grid point over the plane, times the normal's length.
    pub(super) fn height(&self, point: [i32; 3]) -> i128 {
        dot(self.normal.map(i128::from), point.map(i128::from)) - self.offset
    }

    /// Returns the side of a point: 1 in front, -1 at the back, 0 in the plane.
    pub fn side(&self, point: &ExactPoint) -> i32 {
        if let Some(point) = point.on_grid() {
            return self.height(point).signum() as i32;
        }
        self.side_near(point.near).unwrap_or_else(|| {
            let mut sum = product(self.offset, 1) * -point.weight;
            for axis in 0..3 {
                sum += wide(self.normal[axis].into()) * point.at[axis];
            }
            sign(&sum)
        })
    }

    /// Returns the plane with the opposite normal.
    pub fn turned(&self) -> ExactPlane {
        ExactPlane { normal: self.normal.map(|part| -part), offset: -self.offset }
    }

    /// Returns the plane with the smallest numbers and the same front. Equal planes with the same
    /// front have equal numbers then.
    pub fn reduced(&self) -> ExactPlane {
        let divisor = |mut a: u128, mut b: u128| {
            while b > 0 {
                (a, b) = (b, a % b);
            }
            a
        };
        let numbers = self.normal.map(|part| u128::from(part.unsigned_abs()));
        let common = numbers.into_iter().fold(self.offset.unsigned_abs(), divisor).max(1) as i128;
        let normal = self.normal.map(|part| (i128::from(part) / common) as i64);
        ExactPlane { normal, offset: self.offset / common }
    }

    /// Returns the plane after its coordinates are multiplied by `times` and then moved by `shift`.
    pub(crate) fn placed(&self, times: i64, shift: [i64; 3]) -> ExactPlane {
        let moved = dot(self.normal.map(i128::from), shift.map(i128::from));
        ExactPlane { offset: self.offset * i128::from(times) + moved, ..*self }
    }

    /// Returns the plane with permuted axes, some of them mirrored.
    pub(crate) fn permuted(&self, from: [usize; 3], mirrored: [bool; 3]) -> ExactPlane {
        let part =
            |axis: usize| if mirrored[axis] { -self.normal[from[axis]] } else { self.normal[from[axis]] };
        ExactPlane { normal: [0, 1, 2].map(part), offset: self.offset }
    }

    /// Returns the side of an approximate point, with an error of at most
    /// [`POINT_ERROR`](crate::exact::bounds::POINT_ERROR), if the error cannot change it.
    pub(super) fn side_near(&self, near: [f64; 3]) -> Option<i32> {
        let (mut height, mut size) = (-(self.offset as f64), 0.0);
        for (axis, near) in near.into_iter().enumerate() {
            let normal = self.normal[axis] as f64;
            height += normal * near;
            size += normal.abs();
        }
        (height.abs() > size * SIDE_ERROR).then_some(if height > 0.0 { 1 } else { -1 })
    }

    /// Whether two planes are equal, regardless of orientation.
    pub(crate) fn is(&self, other: &ExactPlane) -> bool {
        let axis = self.main_axis();
        cross(self.normal, other.normal) == [0; 3]
            && product(self.offset, other.normal[axis].into())
                == product(other.offset, self.normal[axis].into())
    }

    /// Whether the normal points to the same side as the normal of a parallel plane.
    pub fn is_turned_as(&self, other: &ExactPlane) -> bool {
        let axis = self.main_axis();
        (self.normal[axis] > 0) == (other.normal[axis] > 0)
    }

    /// Returns the axis along which the plane's projection is largest.
    pub fn main_axis(&self) -> usize {
        main_axis(self.normal)
    }
}

/// Returns the cross product of two normals.
pub(crate) fn cross(a: [i64; 3], b: [i64; 3]) -> [i128; 3] {
    vector::cross(a.map(i128::from), b.map(i128::from))
}

/// Returns the number of fraction bits of rounded coordinates on a grid of `bits` bits: rounded
/// coordinates have 58 bits, so that products with three of them fit into 192 bits.
pub(crate) fn fraction_bits(bits: u8) -> u32 {
    58u32.saturating_sub(bits.into())
}

/// Modulus of residues of coordinates: a prime.
pub(crate) const MODULUS: i64 = (1 << 61) - 1;

/// Returns a number below 2^122 modulo [`MODULUS`].
fn reduced(number: u128) -> u64 {
    const LOW: u128 = MODULUS as u128;
    // (2^61 is 1 modulo the modulus.)
    let folded = (number & LOW) + (number >> 61);
    let folded = ((folded & LOW) + (folded >> 61)) as u64;
    if folded >= MODULUS as u64 { folded - MODULUS as u64 } else { folded }
}

/// Returns a signed number modulo [`MODULUS`], at least 0.
fn residue(number: I256) -> u64 {
    // (2^64 is 8 modulo the modulus, and the 2^256 of two's complement is 2^12.)
    let unsigned = [3u32, 2, 1, 0].into_iter().fold(0, |high, word| {
        let digit: u64 = (number >> (64 * word)).as_();
        reduced(u128::from(high) * 8 + u128::from(digit))
    });
    let wrap = if number.is_negative() { MODULUS as u128 - (1 << 12) } else { 0 };
    reduced(u128::from(unsigned) + wrap)
}

/// A point in homogeneous coordinates.
#[derive(Clone, Copy, Debug)]
pub struct ExactPoint {
    pub(crate) at: [I256; 3],
    /// Divisor of the coordinates; positive.
    pub(crate) weight: I256,
    /// The point, with an error of at most [`POINT_ERROR`](crate::exact::bounds::POINT_ERROR).
    pub near: [f64; 3],
    /// Whether the point was made as a grid point; `near` is exact then.
    is_on_grid: bool,
}

impl ExactPoint {
    /// Converts a grid point.
    pub fn of_grid(point: [i32; 3]) -> ExactPoint {
        let at = point.map(|at| wide(at.into()));
        ExactPoint { at, weight: wide(1), near: point.map(f64::from), is_on_grid: true }
    }

    /// Returns the point where an edge meets a plane. `start` and `end` are the distinct heights of
    /// its ends over the plane, up to a common factor.
    pub(super) fn of_edge([from, to]: [[i32; 3]; 2], [start, end]: [i128; 2]) -> ExactPoint {
        // A weighted mean of the ends.
        let (weight, start) = if start > end { (start - end, start) } else { (end - start, -start) };
        let at = std::array::from_fn(|axis| {
            let along = i128::from(to[axis]) - i128::from(from[axis]);
            product(weight, from[axis].into()) + product(start, along)
        });
        ExactPoint::new(at, wide(weight))
    }

    /// Returns the intersection point of three planes, which must have exactly one.
    pub fn of_planes(planes: [&ExactPlane; 3]) -> ExactPoint {
        let [a, b, c] = planes;
        let crosses = [cross(b.normal, c.normal), cross(c.normal, a.normal), cross(a.normal, b.normal)];
        let mut weight = wide(0);
        for (along, across) in a.normal.into_iter().zip(crosses[0]) {
            weight += product(along.into(), across);
        }
        let mut at = [0, 1, 2].map(|axis| {
            let mut sum = wide(0);
            for (plane, cross) in planes.iter().zip(&crosses) {
                sum += product(plane.offset, cross[axis]);
            }
            sum
        });
        if weight.is_negative() {
            weight = -weight;
            at = at.map(|at| -at);
        }
        ExactPoint::new(at, weight)
    }

    /// Returns the point with given homogeneous coordinates and a positive weight.
    pub(crate) fn of(at: [I256; 3], weight: I256) -> ExactPoint {
        ExactPoint::new(at, weight).settled()
    }

    /// Returns the point with given homogeneous coordinates and a positive weight, without the test
    /// whether it is a grid point.
    fn new(at: [I256; 3], weight: I256) -> ExactPoint {
        // Invariant: weights are not negative, and 0 only for faces that are not flat. Constructors
        // negate all four numbers if necessary, and files are checked. Sides, orders and areas are
        // signs of sums with weights as factors: a negative weight would negate them.
        debug_assert!(!weight.is_negative());
        let size: f64 = weight.as_();
        let near = at.map(|at| {
            let at: f64 = at.as_();
            at / size
        });
        ExactPoint { at, weight, near, is_on_grid: false }
    }

    /// Returns the coordinates of a point that was made as a grid point.
    pub(crate) fn on_grid(&self) -> Option<[i32; 3]> {
        self.is_on_grid.then(|| self.near.map(|at| at as i32))
    }

    /// Returns the point, marked as a grid point if it is one.
    pub fn settled(self) -> ExactPoint {
        if self.is_on_grid {
            return self;
        }
        let rounded = ExactPoint::of_grid(self.rounded());
        if self.is(&rounded) { rounded } else { self }
    }

    /// Returns the point after its coordinates are multiplied by `times` and then moved by `shift`.
    pub(crate) fn placed(&self, times: i64, shift: [i64; 3]) -> ExactPoint {
        let at =
            [0, 1, 2].map(|axis| self.at[axis] * wide(times.into()) + self.weight * wide(shift[axis].into()));
        match self.is_on_grid {
            true => ExactPoint::of_grid(at.map(|at| at.as_())),
            false => ExactPoint::new(at, self.weight),
        }
    }

    /// Returns the point with permuted axes, some of them mirrored.
    pub(crate) fn permuted(&self, from: [usize; 3], mirrored: [bool; 3]) -> ExactPoint {
        let at = |axis: usize| if mirrored[axis] { -self.at[from[axis]] } else { self.at[from[axis]] };
        let near = |axis: usize| if mirrored[axis] { -self.near[from[axis]] } else { self.near[from[axis]] };
        ExactPoint { at: [0, 1, 2].map(at), near: [0, 1, 2].map(near), ..*self }
    }

    /// Compares two points along an axis.
    pub fn compare(&self, other: &ExactPoint, axis: usize) -> Ordering {
        let difference = self.near[axis] - other.near[axis];
        if difference.abs() > ORDER_ERROR {
            return if difference > 0.0 { Ordering::Greater } else { Ordering::Less };
        }
        if self.is_on_grid && other.is_on_grid {
            return Ordering::Equal;
        }
        if self.weight.is_zero() || other.weight.is_zero() {
            // Faces that are not flat have undefined points. Any order will do, as long as it is
            // total.
            return self.near[axis].total_cmp(&other.near[axis]);
        }
        let (a, b): (I512, I512) = (self.at[axis].as_(), other.at[axis].as_());
        let (weight, other_weight): (I512, I512) = (self.weight.as_(), other.weight.as_());
        (a * other_weight).cmp(&(b * weight))
    }

    /// Whether two points are equal.
    pub fn is(&self, other: &ExactPoint) -> bool {
        (0..3).all(|axis| self.compare(other, axis) == Ordering::Equal)
    }

    /// Returns the coordinates in units of 2^-`fraction_bits`, rounded down. They depend on the
    /// point alone, not on its weight.
    pub(crate) fn fixed(&self, fraction_bits: u32) -> [i64; 3] {
        if self.is_on_grid {
            return self.near.map(|at| (at as i64) << fraction_bits);
        }
        if self.weight.is_zero() {
            return [0; 3];
        }
        // (Weights have at most 171 bits, and rounded coordinates 58.)
        self.at.map(|at| (at << fraction_bits).div_euclid(self.weight).as_())
    }

    /// Returns residues of the coordinates modulo [`MODULUS`]. They depend on the point alone, not
    /// on its weight.
    pub(crate) fn residues(&self) -> [i64; 3] {
        let times = |a: u64, b: u64| reduced(u128::from(a) * u128::from(b));
        // The inverse of the weight, by Fermat's theorem.
        let (mut inverse, mut power, mut exponent) = (1, residue(self.weight), MODULUS - 2);
        while exponent > 0 {
            if exponent & 1 == 1 {
                inverse = times(inverse, power);
            }
            power = times(power, power);
            exponent >>= 1;
        }
        self.at.map(|at| times(residue(at), inverse) as i64)
    }

    /// Returns the nearest grid point. Ties are rounded up.
    pub(crate) fn rounded(&self) -> [i32; 3] {
        std::array::from_fn(|axis| {
            let near = self.near[axis];
            let rounded = near.round();
            // (The distance from the midpoint between two grid points.)
            if (near - rounded).abs() < 0.5 - ORDER_ERROR {
                return rounded as i32;
            }
            let low = near.floor() as i32;
            let twice_middle = wide(2 * i128::from(low) + 1) * self.weight;
            low.saturating_add((self.at[axis] + self.at[axis] >= twice_middle).into())
        })
    }
}

/// Returns twice the signed area of a triangle projected along an axis, times all weights. It is
/// positive if the triangle is counterclockwise as seen from the axis's positive end.
pub(super) fn area(axis: usize, [a, b, c]: [&ExactPoint; 3]) -> I1024 {
    let [u, v] = others(axis);
    let minor = |p: &ExactPoint, q: &ExactPoint| -> I1024 {
        let widen = |number: I256| -> I512 { number.as_() };
        (widen(p.at[u]) * widen(q.at[v]) - widen(p.at[v]) * widen(q.at[u])).as_()
    };
    let weight = |p: &ExactPoint| -> I1024 { p.weight.as_() };
    minor(a, b) * weight(c) + minor(b, c) * weight(a) + minor(c, a) * weight(b)
}

/// Returns the sign of [`area`].
pub(super) fn turn(axis: usize, corners: [&ExactPoint; 3]) -> i32 {
    let [u, v] = others(axis);
    let [a, b, c] = corners.map(|point| [point.near[u], point.near[v]]);
    if corners.iter().all(|point| point.is_on_grid) {
        let along = |from: [f64; 2], to: [f64; 2]| [(to[0] - from[0]) as i64, (to[1] - from[1]) as i64];
        let (along, to) = (along(a, b), along(a, c));
        return (along[0] * to[1] - along[1] * to[0]).signum() as i32;
    }
    let (along, to) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
    let area = along[0] * to[1] - along[1] * to[0];
    let size = along[0].abs() + along[1].abs() + to[0].abs() + to[1].abs();
    if area.abs() > (size + 1.0) * TURN_ERROR {
        return if area > 0.0 { 1 } else { -1 };
    }
    sign(&self::area(axis, corners))
}

/// Widens a number to 256 bits.
pub(crate) fn wide(number: i128) -> I256 {
    number.as_()
}

/// Returns the product of two numbers.
pub(super) fn product(a: i128, b: i128) -> I256 {
    wide(a) * wide(b)
}

/// Returns the sign of a number.
pub(super) fn sign<const N: usize>(number: &bnum::Int<N>) -> i32 {
    if number.is_negative() { -1 } else { i32::from(!number.is_zero()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exact::bounds::{MAX_BITS, NORMAL_BITS, POINT_ERROR};
    use crate::exact::normal::ring_normal;

    fn random(seed: u64) -> impl FnMut(i32) -> i32 {
        let mut state = seed;
        move |below| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            ((state >> 33) as i32).rem_euclid(below)
        }
    }

    /// Intersection points of planes, and of edges with planes, lie in these planes, for any size
    /// of the coordinates.
    #[test]
    fn points_lie_in_their_planes() {
        let mut number = random(1);
        for round in 0..3000 {
            let far = [8, 1 << 10, (1 << 26) - 1][round % 3];
            let mut point = || [number(far), number(far), number(far)];
            let mut plane = || loop {
                let corners = [point(), point(), point()];
                let normal = ring_normal(&corners);
                if normal != [0; 3] {
                    return (ExactPlane::through(corners[0], normal), corners);
                }
            };
            let ((a, corners), (b, _), (c, _)) = (plane(), plane(), plane());
            assert!(corners.iter().all(|corner| a.side(&ExactPoint::of_grid(*corner)) == 0));
            let (from, to) = (corners[0], corners[1]);
            let heights = [b.height(from), b.height(to)];
            if heights[0].signum() * heights[1].signum() < 0 {
                let met = ExactPoint::of_edge([from, to], heights);
                assert_eq!((a.side(&met), b.side(&met)), (0, 0));
                assert!(
                    met.rounded()
                        .iter()
                        .zip(met.near)
                        .all(|(at, near)| (f64::from(*at) - near).abs() <= 0.5 + POINT_ERROR)
                );
            }
            let parallel = rank(&[&a, &b, &c]) < 3;
            if parallel {
                continue;
            }
            let common = ExactPoint::of_planes([&a, &b, &c]);
            assert!([&a, &b, &c].iter().all(|plane| plane.side(&common) == 0));
            let turned = ExactPoint::of_planes([&c, &a, &b]);
            assert!(common.is(&turned));
            // A point one unit away is different.
            let shifted = ExactPoint { at: [common.at[0] + wide(1), common.at[1], common.at[2]], ..common };
            assert!(!common.is(&shifted) && common.compare(&shifted, 0) == Ordering::Less);
        }
    }

    fn rank(planes: &[&ExactPlane; 3]) -> usize {
        let [a, b, c] = planes.map(|plane| plane.normal);
        let along = cross(a, b);
        let sum = (0..3).fold(wide(0), |sum, axis| sum + product(along[axis], c[axis].into()));
        if sum.is_zero() { 2 } else { 3 }
    }

    /// Planes with the maximum normals, through the outermost points, do not overflow (an overflow
    /// would panic).
    #[test]
    fn the_widest_numbers_fit() {
        let (far, most) = ((1 << MAX_BITS) - 1, (1i64 << NORMAL_BITS) - 1);
        let normals =
            [[1, 1, -1], [1, -1, 1], [-1, 1, 1], [1, 1, 1]].map(|normal| normal.map(|part: i64| part * most));
        let corner = |bits: usize| [0, 1, 2].map(|axis| if bits >> axis & 1 == 1 { far } else { 0 });
        for (at, base) in (0..64).map(|n| (corner(n / 8), corner(n % 8))) {
            let [a, b, c, _] = normals.map(|normal| ExactPlane::through(at, normal));
            let common = ExactPoint::of_planes([&a, &b, &c]);
            assert_eq!(common.near, at.map(f64::from));
            // (Without the floating-point filter.)
            let blind = ExactPoint { near: [f64::NAN; 3], ..common };
            for normal in normals {
                let plane = ExactPlane::through(base, normal);
                assert_eq!(
                    plane.side(&blind),
                    plane.height(at).signum() as i32,
                    "{at:?} {base:?} {normal:?}"
                );
                // One unit off the point decides.
                let own = ExactPlane::through(at, normal);
                let shifted = |unit: i128| ExactPlane { offset: own.offset + unit, ..own };
                assert_eq!([-1, 0, 1].map(|unit| shifted(unit).side(&blind)), [1, 0, -1]);
            }
            let turned = ExactPoint::of_planes([&c.turned(), &b, &a]);
            assert!(blind.is(&ExactPoint { near: [f64::NAN; 3], ..turned }));
            let others = [1, 2].map(|bits| ExactPoint::of_grid(corner(bits)));
            assert_eq!(
                turn(2, [&blind, &others[0], &others[1]]),
                turn(2, [&ExactPoint::of_grid(at), &others[0], &others[1]])
            );
        }
    }

    #[test]
    fn middles_are_rounded_up_however_they_are_written() {
        let half = |scale: i128| ExactPoint {
            at: [wide(7 * scale), wide(-7 * scale), wide(6 * scale)],
            weight: wide(2 * scale),
            near: [3.5, -3.5, 3.0],
            is_on_grid: false,
        };
        for scale in [1, 3, 1 << 100] {
            assert_eq!(half(scale).rounded(), [4, -3, 3]);
        }
        let below = ExactPoint {
            at: [wide((7 << 100) - 1), wide(0), wide(0)],
            weight: wide(2 << 100),
            near: [3.5, 0.0, 0.0],
            is_on_grid: false,
        };
        assert_eq!(below.rounded(), [3, 0, 0]);
    }

    #[test]
    fn turns_are_those_of_integers() {
        let mut number = random(5);
        for _ in 0..3000 {
            let corners = [0; 3].map(|_| [number(4), number(4), number(4)]);
            let normal = ring_normal(&corners);
            let points = corners.map(ExactPoint::of_grid);
            for (axis, along) in normal.into_iter().enumerate() {
                assert_eq!(turn(axis, [&points[0], &points[1], &points[2]]), along.signum() as i32);
            }
        }
    }
}

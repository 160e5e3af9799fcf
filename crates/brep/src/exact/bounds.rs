//! Bit widths and rounding errors of the exact arithmetic: each is derived from the widths of the
//! two grids.
//!
//! `..._BITS` bound magnitudes: a number of `b` bits is less than `2^b`, and takes one more bit for
//! its sign. `B` is the side of a model's grid, `N` a bound of normal components. Every derivation
//! holds for coordinates from -1 to `B`, which contain all vertices that faces are split at.

/// Maximum number of bits of a coordinate of a model's grid. Every predicate on faces with such
/// coordinates fits into 256 bits; with one more bit, it would not: see `SIDE_BITS`.
pub const MAX_BITS: u8 = 26;

/// Bits of a coordinate in the solids' grid, cells and fraction together. It is not the grid of
/// models, which has fewer bits: [`lattice`](super::lattice) classifies cells in 64 bits and needs
/// no points of three planes, and triangles should be as accurate as that allows.
///
/// Vertices may be outside of the space by up to its width `S`: coordinates are from `-S` to `2 S`,
/// and differences up to `3 S`. The side of an edge is a sum of two products of such differences,
/// up to `18 S^2`. In a row of points it goes one more step past the edge's box, which is shorter
/// than `S`: up to `24 S^2` in all, plus 1 for the tie-break of points on the edge.
pub const SOLID_BITS: u8 = 29;

const _: () = assert!(24 * (1i128 << (2 * SOLID_BITS)) < i64::MAX as i128, "sides of edges in 64 bits");
const _: () = assert!(24 * (1i128 << (2 * SOLID_BITS + 2)) > i64::MAX as i128, "and none to spare");
const _: () = assert!(3 * (1i64 << SOLID_BITS) < 1 << 31, "coordinates in 32 bits, differences in 31");

/// Bits of a coordinate of a line's end, in fractions of the model's grid unit; ends are at most
/// one grid unit outside of the grid.
///
/// The distance from an end to a vertex is at most `2 L` per axis, and so is the line's length. A
/// turn around the line is the triple product of such vectors, a sum of six products of their
/// components: up to `48 L^3`.
pub(crate) const LINE_BITS: u8 = 40;

const _: () = assert!(LINE_BITS > MAX_BITS);
const _: () = assert!(3 * LINE_BITS + 6 < 127, "48 is less than 2^6");

/// Fraction bits of a query point's coordinates.
pub(crate) const FINE_BITS: u32 = 32;

// Crossings along an axis: the vector to such a point has one integer bit more than the grid. Its
// products with a normal of 62 bits or an edge's gradient are added up three times.
const _: () = assert!(MAX_BITS as u32 + 1 + FINE_BITS < 63);
const _: () = assert!(62 + MAX_BITS as u32 + 1 + FINE_BITS + 2 < 127);

/// Bits of normal components. A ring that goes once around the whole grid has a component of twice
/// the square of the grid's side: `2 B^2`. Three more bits allow rings that do so up to eight
/// times. (Files with larger normals are rejected where [`SIDE_BITS`] depends on it.)
pub(crate) const NORMAL_BITS: u32 = 2 * MAX_BITS as u32 + 4;

/// Bits of a plane's offset: the sum of three products of a normal component and a coordinate,
/// `3 N B`.
pub(crate) const OFFSET_BITS: u32 = NORMAL_BITS + MAX_BITS as u32 + 2;

/// Bits of the direction of two planes' line: two products of normal components, `2 N^2`.
const DIRECTION_BITS: u32 = 2 * NORMAL_BITS + 1;

/// Bits of the weight of a point of three planes: their determinant, `6 N^3`.
pub(crate) const WEIGHT_BITS: u32 = 3 * NORMAL_BITS + 3;

/// Bits of the products of a point's coordinates and its weight.
const POINT_BITS: u32 = WEIGHT_BITS + MAX_BITS as u32;

/// Bits of the test on which side of a plane a point of three planes is: `9 b + 21` for coordinates
/// of `b` bits.
///
/// The value is the weight times the dot product of the normal and the vector from a point of the
/// plane, whose components are at most `B`: `6 N^3` times `3 N B`. The sum starts with the offset,
/// and its remaining terms represent the missing vector components, so no partial sum is larger.
/// (18 is less than 2^5.)
const SIDE_BITS: u32 = 4 * NORMAL_BITS + MAX_BITS as u32 + 5;

const _: () = assert!(SIDE_BITS == 9 * MAX_BITS as u32 + 21);
const _: () = assert!(SIDE_BITS <= 255, "sides in 256 bits with the sign");
const _: () = assert!(SIDE_BITS + 9 > 255, "no grid with one bit more has that");
// The sum of a point of three planes, from three products of an offset and a direction: `18 N^3 B`.
const _: () = assert!(3 * NORMAL_BITS + MAX_BITS as u32 + 5 <= 255);
// Normals in 64 bits; offsets, directions, and their components, in 128.
const _: () = assert!(NORMAL_BITS <= 63 && OFFSET_BITS <= 127 && DIRECTION_BITS <= 127);
// The vectors of half-planes around a segment, products of a normal and a direction, in 256 bits;
// the dot product of two of these in 512.
const ACROSS_BITS: u32 = NORMAL_BITS + DIRECTION_BITS + 1;
const _: () = assert!(ACROSS_BITS <= 255 && 2 * ACROSS_BITS + 2 <= 511);
// The order of two points along an axis.
const _: () = assert!(POINT_BITS + WEIGHT_BITS <= 511);

/// Bits of the weight of the mean of three points, three times the product of their weights, and of
/// the coordinates times it.
const MEAN_WEIGHT_BITS: u32 = 3 * WEIGHT_BITS + 2;
const MEAN_BITS: u32 = MEAN_WEIGHT_BITS + MAX_BITS as u32;

// Turns around such means: sums of three products of a minor of two points and the third point's
// weight.
const _: () = assert!(2 * POINT_BITS + 1 + MEAN_WEIGHT_BITS + 2 <= 1023);
const _: () = assert!(POINT_BITS + MEAN_BITS + 1 + WEIGHT_BITS + 2 <= 1023);
// Areas of three points, compared after multiplication by a weight.
const _: () = assert!(2 * POINT_BITS + 1 + 2 * WEIGHT_BITS + 2 <= 1023);
// The side of a plane on which a mean is, in coordinates of its own plane, which multiply
// everything by a normal component once more.
const _: () = assert!(2 * NORMAL_BITS + MEAN_BITS + 4 <= 1023);

/// Bits of the determinant of four planes; each row is a normal of 62 bits and an offset:
/// `4 * 3 N B * 6 N^3`.
pub(crate) const DETERMINANT_BITS: u32 = 4 * 62 + MAX_BITS as u32 + 7;

/// Maximum relative rounding error of a double.
const ROUNDOFF: f64 = f64::EPSILON / 2.0;

/// Relative error bound of a sum of products, as a share of the sum of its terms' magnitudes, if at
/// most `count` consecutive roundings lead from integers to the sum through any term. A sum that is
/// larger than this bound has the right sign.
///
/// `n` roundings change a term by at most `n u / (1 - n u)`, where `u` is the error of one (Higham,
/// "Accuracy and Stability of Numerical Algorithms", 2002, lemma 3.1). One more rounding covers the
/// second order, and the rounding of the magnitudes and of this bound.
const fn after_roundings(count: u32) -> f64 {
    (count + 1) as f64 * ROUNDOFF
}

/// For the side of an edge, seen along an axis: conversion of two numbers to doubles, their
/// product, the sum of two of them.
pub(crate) const CROSSING_ROUNDING: f64 = after_roundings(4);

/// For the height of a point over a plane: conversion of a normal component and a difference to
/// doubles, their product, two additions.
pub(crate) const HEIGHT_ROUNDING: f64 = after_roundings(5);

/// For the height of a grid point over a triangle, whose normal and differences are exact doubles:
/// a product, two additions.
pub(crate) const TRIANGLE_HEIGHT_ROUNDING: f64 = after_roundings(3);

// A triangle's normal is at most `B^2`, a difference of products of this size.
const _: () = assert!(2 * MAX_BITS as u32 <= f64::MANTISSA_DIGITS);

/// For the distance between a plane and a cube: the height of a vertex with differences that are
/// exact doubles (conversion of a normal component, a product, two additions), minus the cube's
/// extent with the same error.
pub(crate) const CUBE_ROUNDING: f64 = after_roundings(5);

/// For whether a plane misses the point of three others. Normal components are converted to
/// doubles. A direction is a product of two of these and a subtraction (4 roundings). An offset is
/// a product of one and two additions (4). The determinant combines a direction and a normal (8).
/// The point is a product of offset and direction, and an addition (10). The dot product with a
/// normal has one more conversion and product, and two additions (14), from which the product of
/// offset and determinant is subtracted (15).
pub(crate) const RANK_ROUNDING: f64 = after_roundings(15);

/// For the intersection of a lattice line and a triangle's plane, as a share of the bound on the
/// terms' magnitudes, which may be exceeded by a factor of two. A slope takes two conversions and
/// two divisions, and its product with a distance one more rounding. So do the slope's steps, and
/// their number adds another one. Three additions follow.
pub(crate) const LATTICE_ROUNDING: f64 = 2.0 * after_roundings(9);

/// Maximum difference between a point's coordinate and its double, in grid units: eight roundings
/// of the largest coordinate.
///
/// A point of three planes is the quotient of two wide integers, which are converted to doubles:
/// three roundings. The mean of three such points has the same error, plus a third of two roundings
/// of sums, of `2 B` and `3 B`, and that of the quotient: less than six in all. (If wide integers
/// are truncated instead of rounded, which counts as two roundings: five, and less than eight.)
///
/// Invariant: the errors of such doubles are less than this, since points are within the grid. The
/// fast paths (`ExactPlane::side`, `ExactPoint::compare`, `turn`) compare with a multiple of this,
/// and accept larger differences. Outside of the grid, their results would be wrong, not just slow.
pub(crate) const POINT_ERROR: f64 = 8.0 * ROUNDOFF * (1u64 << MAX_BITS) as f64;

const _: () = assert!(POINT_ERROR == 1.0 / (1 << 24) as f64);

/// Minimum difference of two such doubles that proves the order of the points.
pub(crate) const ORDER_ERROR: f64 = 2.0 * POINT_ERROR;

/// Maximum error of twice the area of a triangle of such points, per unit of the coordinate
/// differences. Each difference has twice the error and a rounding, and is multiplied by the other
/// one; the products and their difference add roundings of a quarter of the error.
pub(crate) const TURN_ERROR: f64 = 4.0 * POINT_ERROR;

/// Maximum error of the height of such a point over a plane, per unit of the normal components. It
/// consists of the point's error, and of roundings of at most `3 B` in the offset, of `B` twice in
/// each product, and of at most `3 B` in each of three sums: eighteen roundings, or two and a
/// quarter more errors. (If the point was computed from a plane along its main axis, the third
/// coordinate has half as much error again.)
pub(crate) const SIDE_ERROR: f64 = 8.0 * POINT_ERROR;

/// Minimum distance, in grid units, that proves that such doubles differ, whatever they were
/// computed from: twice the error, and the rounding of its addition.
pub(crate) const MARGIN: f64 = 16.0 * POINT_ERROR;

/// For the turn of an edge around a line, whose vectors are exact doubles: two products and a
/// subtraction for each component of the cross product, a product with the vector, two additions;
/// and three more in the sum of the magnitudes.
pub(crate) const TURN_ROUNDING: f64 = after_roundings(5 + 3);

// Differences between the line's ends and grid points are exact doubles.
const _: () = assert!(LINE_BITS as u32 + 2 <= f64::MANTISSA_DIGITS);

/// For the parameter at which a line enters a box, and that at which it meets a face: quotients of
/// integers. Those of boxes are products with a reciprocal, and those of faces are converted to
/// doubles first; five roundings in all, and one for adding the bound. (The later conversion from
/// parameters of a segment to those of the whole line is monotone.)
pub(crate) const SHARE_ROUNDING: f64 = after_roundings(6);

/// Relative error of a face's squared distance, so that the distance of its bounding box is never
/// larger: each coordinate of the vector to the nearest point of an edge takes about fifteen
/// roundings, and the square of its length twice as many and three more.
///
/// Inside of a face, the error may be larger, in proportion to the distance of the farthest vertex:
/// of two faces at nearly the same distance, either may be returned as the nearest.
pub(crate) const DISTANCE_ROUNDING: f64 = 1.0 / (1u64 << 40) as f64;

const _: () = assert!(DISTANCE_ROUNDING > after_roundings(2 * 15 + 3));

/// For the share of a cell that is inside, as a sum of terms up to a cell's size: a sum below the
/// rounding error of eight additions counts as zero.
pub(crate) const CELL_ROUNDING: f64 = after_roundings(8);

#[cfg(test)]
mod tests {
    use bnum::cast::As;
    use bnum::types::{I256, I512};

    use super::*;
    use crate::arrangement::ExactPoint;
    use crate::exact::crossing::{FinePoint, Outline};

    fn random(seed: u64) -> impl FnMut() -> u64 {
        let mut state = seed;
        move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            state ^ (state >> 29)
        }
    }

    /// Doubles of points with the largest coordinates and weights are within the error bound.
    #[test]
    fn doubles_of_points_are_as_near_as_stated() {
        let mut next = random(3);
        let mut most = 0f64;
        for round in 0..4000u32 {
            let bits = [WEIGHT_BITS, 60, 53, 7][round as usize % 4];
            let weight: I256 =
                (0..4).fold(I256::default(), |all, _| (all << 63u32) + (next() >> 1).as_::<I256>());
            let weight = (weight >> (252 - bits)) + 1.as_::<I256>();
            let side: I256 = (1u64 << MAX_BITS).as_();
            // Just below an integer near the grid's end, and anywhere.
            let at = [0, 1, 2].map(|axis| {
                let low: I256 = (next() % 1024).as_();
                let share: I256 = (next() >> 32).as_();
                match axis {
                    0 => (side - low) * weight - 1.as_::<I256>(),
                    1 => (side - low) * weight - ((weight * share) >> 32u32),
                    _ => (weight * share) >> 6u32,
                }
            });
            let near = ExactPoint::of(at, weight).near;
            for (at, near) in at.into_iter().zip(near) {
                // Both multiplied by 2^53: a double from 2^-1 on is an integer then.
                let scaled: I512 = (near * (1u64 << 53) as f64).as_();
                let off: I512 = scaled * weight.as_::<I512>() - (at.as_::<I512>() << 53u32);
                let off = off.as_::<f64>().abs() / weight.as_::<f64>() / (1u64 << 53) as f64;
                most = most.max(off);
            }
        }
        assert!(most < POINT_ERROR / 2.0, "{most}");
        assert!(most > POINT_ERROR / 16.0, "{most}: the bound is not much too large");
    }

    /// One unit decides about points next to the largest planes, with the maximum number of
    /// fraction bits.
    #[test]
    fn heights_are_those_of_whole_numbers() {
        let mut next = random(7);
        let far = (1i32 << MAX_BITS) - 1;
        let mut sides = [0; 3];
        for _ in 0..20_000 {
            let mut coordinate = || match next() % 4 {
                0 => 0,
                1 => far,
                _ => (next() >> 20) as i32 & far,
            };
            let corners = [0; 3].map(|_| [0; 3].map(|_| coordinate()));
            let normal = super::super::normal::ring_normal(&corners);
            let outline = Outline { points: &corners, ring_ends: &[3], normal };
            // A vertex, or a point near the plane, shifted by at most one of the smallest
            // fractions.
            let [p, q, r] = corners;
            let share = i64::from(next() as u32 >> 1);
            let at = [0, 1, 2].map(|axis| {
                let [p, q, r] = [p, q, r].map(|corner| i64::from(corner[axis]) << FINE_BITS);
                let deviation = (next() % 3) as i64 - 1;
                p + ((i128::from(q - p) * i128::from(share)) >> 33) as i64
                    + (r - p) / 4 * (share & 1)
                    + deviation
            });
            let point = FinePoint { at, bits: FINE_BITS };
            let exact: I256 = (0..3).fold(I256::default(), |sum, axis| {
                let along = at[axis] - (i64::from(p[axis]) << FINE_BITS);
                sum + normal[axis].as_::<I256>() * along.as_::<I256>()
            });
            let side = i32::from(exact.is_positive()) - i32::from(exact.is_negative());
            assert_eq!(outline.side(&point), side, "{corners:?} {at:?}");
            sides[(side + 1) as usize] += 1;
        }
        assert!(sides.iter().all(|count| *count > 100), "{sides:?}");
    }

    /// Sums of products never exceed the bound for the stated number of roundings, and some almost
    /// reach it.
    #[test]
    fn sums_are_rounded_as_often_as_stated() {
        let mut next = random(11);
        let mut most = [0f64; 2];
        for _ in 0..100_000 {
            let wide = |bits: u32, number: u64| (number >> (64 - bits)) as i64 | 1;
            let [a, b, c] = [0; 3].map(|_| wide(61, next()));
            let [x, y, z] = [0; 3].map(|_| wide(59, next()));
            let share = |terms: &[(i64, i64)]| {
                let parts = terms.iter().map(|(a, b)| *a as f64 * *b as f64);
                let sum = parts.fold(0.0, |sum, part| sum + part);
                let exact: i128 = terms.iter().map(|(a, b)| i128::from(*a) * i128::from(*b)).sum();
                (sum as i128 - exact).abs() as f64 / exact as f64
            };
            most[0] = most[0].max(share(&[(a, x), (b, y)]) / CROSSING_ROUNDING);
            most[1] = most[1].max(share(&[(a, x), (b, y), (c, z)]) / HEIGHT_ROUNDING);
        }
        assert!(most.iter().all(|most| (0.2..1.0).contains(most)), "{most:?}");
    }
}

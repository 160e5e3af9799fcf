//! Bits that numbers need, and what doubles lose of them: each derived from the widths of the two grids.
//!
//! `..._BITS` bound magnitudes: a number of so many bits is less than two to their power, and takes one more for its
//! sign. `B` is the side of a model's grid, `N` a bound of the components of normals; every derivation is for
//! coordinates from -1 to `B`, which is where all corners lie that faces are divided at.

/// Most bits of a coordinate of a model's grid. Whatever is decided about faces with such coordinates fits into 256
/// bits, and no grid with one bit more has that: see `SIDE_BITS`.
pub const MAX_BITS: u8 = 26;

/// Bits of a coordinate in the space of the solids' grid, cells and fraction together; another grid than that of
/// models, which has fewer: cells are told apart by [`lattice`](super::lattice) in 64 bits, and never by points of
/// three planes, and a triangle has to lie where it is as nearly as that allows.
///
/// Vertices may lie outside by as much as the space is wide: coordinates run from `-S` to `2 S`, differences to `3 S`.
/// The side of an edge is a sum of two products of such differences, to `18 S^2`, and in a row of points one more step
/// past the edge's box, which is less than `S` long: to `24 S^2` in all, and 1 for who is on the edge.
pub const SOLID_BITS: u8 = 29;

const _: () = assert!(24 * (1i128 << (2 * SOLID_BITS)) < i64::MAX as i128, "sides of edges in 64 bits");
const _: () = assert!(24 * (1i128 << (2 * SOLID_BITS + 2)) > i64::MAX as i128, "and none to spare");
const _: () = assert!(3 * (1i64 << SOLID_BITS) < 1 << 31, "coordinates in 32 bits, differences in 31");

/// Bits of a coordinate of a line's end, in parts of a step of the model's grid: one step outside of it at most.
///
/// From an end to a corner it is `2 L` at most, and the line is as long. A turn around the line is the product of three
/// such vectors, a sum of six products of their parts: to `48 L^3`.
pub(crate) const LINE_BITS: u8 = 40;

const _: () = assert!(LINE_BITS > MAX_BITS);
const _: () = assert!(3 * LINE_BITS + 6 < 127, "48 is less than 2^6");

/// Bits of a coordinate of a point that is asked for, behind the point.
pub(crate) const FINE_BITS: u32 = 32;

// Crossings along an axis: the way to such a point has a bit more than the grid before its point, and times a normal of
// 62 bits, or an edge's gradient, is added up three times.
const _: () = assert!(MAX_BITS as u32 + 1 + FINE_BITS < 63);
const _: () = assert!(62 + MAX_BITS as u32 + 1 + FINE_BITS + 2 < 127);

/// Bits of the components of a normal. A ring that goes around everything once has a component of twice the square of
/// the grid's side: `2 B^2`. Three bits more are for rings that do so up to eight times. (Files with normals that are
/// larger are refused where [`SIDE_BITS`] depends on it.)
pub(crate) const NORMAL_BITS: u32 = 2 * MAX_BITS as u32 + 4;

/// Bits of a plane's offset: of three products of a normal's component and a coordinate, `3 N B`.
pub(crate) const OFFSET_BITS: u32 = NORMAL_BITS + MAX_BITS as u32 + 2;

/// Bits of the components of the direction of the line of two planes: two products of normals' components, `2 N^2`.
const DIRECTION_BITS: u32 = 2 * NORMAL_BITS + 1;

/// Bits of the weight of a point of three planes: their determinant, `6 N^3`.
pub(crate) const WEIGHT_BITS: u32 = 3 * NORMAL_BITS + 3;

/// Bits of the products of a point's coordinates with its weight.
const POINT_BITS: u32 = WEIGHT_BITS + MAX_BITS as u32;

/// Bits that a test takes on which side of a plane a point of three planes lies: `9 b + 21` for coordinates of `b` bits.
///
/// It is the weight times the scalar product of the normal and the way from a point of the plane, of which each
/// component is `B` at most: `6 N^3` times `3 N B`. As it is added up, offset first, what is still missing stands for
/// that component of the way, so that no part of the sum is more. (18 is less than 2^5.)
const SIDE_BITS: u32 = 4 * NORMAL_BITS + MAX_BITS as u32 + 5;

const _: () = assert!(SIDE_BITS == 9 * MAX_BITS as u32 + 21);
const _: () = assert!(SIDE_BITS <= 255, "sides in 256 bits with the sign");
const _: () = assert!(SIDE_BITS + 9 > 255, "no grid with one bit more has that");
// As a point of three planes is added up, from three products of an offset and a direction: `18 N^3 B`.
const _: () = assert!(3 * NORMAL_BITS + MAX_BITS as u32 + 5 <= 255);
// Normals in 64 bits; offsets, directions, and the components that these are made of, in 128.
const _: () = assert!(NORMAL_BITS <= 63 && OFFSET_BITS <= 127 && DIRECTION_BITS <= 127);
// The vectors of half-planes around a segment, products of a normal and a direction, and the scalar product of two of
// these, in 256 and 512.
const ACROSS_BITS: u32 = NORMAL_BITS + DIRECTION_BITS + 1;
const _: () = assert!(ACROSS_BITS <= 255 && 2 * ACROSS_BITS + 2 <= 511);
// The order of two points along an axis.
const _: () = assert!(POINT_BITS + WEIGHT_BITS <= 511);

/// Bits of the weight of the mean of three points, three times the product of theirs, and of the coordinates times it.
const MEAN_WEIGHT_BITS: u32 = 3 * WEIGHT_BITS + 2;
const MEAN_BITS: u32 = MEAN_WEIGHT_BITS + MAX_BITS as u32;

// Turns around such means, sums of three products of a minor of two points and the weight of the third.
const _: () = assert!(2 * POINT_BITS + 1 + MEAN_WEIGHT_BITS + 2 <= 1023);
const _: () = assert!(POINT_BITS + MEAN_BITS + 1 + WEIGHT_BITS + 2 <= 1023);
// Areas of three points, compared after multiplication with a weight.
const _: () = assert!(2 * POINT_BITS + 1 + 2 * WEIGHT_BITS + 2 <= 1023);
// The side of a plane on which a mean lies, in coordinates of its own plane, which multiply all with a normal's
// component once more.
const _: () = assert!(2 * NORMAL_BITS + MEAN_BITS + 4 <= 1023);

/// Bits of the determinant of four planes, of which each row is a normal of 62 bits and an offset: `4 * 3 N B * 6 N^3`.
pub(crate) const DETERMINANT_BITS: u32 = 4 * 62 + MAX_BITS as u32 + 7;

/// The most that a double is rounded by, as a share of it.
const ROUNDOFF: f64 = f64::EPSILON / 2.0;

/// The share of the sum of its terms' magnitudes that a sum of products can be off by where doubles are rounded so
/// often, one after the other, on the way from whole numbers by any of its terms: a sum that is more than that has the
/// right sign.
///
/// By `n` roundings a term changes by `n / (1 - n u)` times `u`, the most that one does (Higham, "Accuracy and
/// Stability of Numerical Algorithms", 2002, lemma 3.1). One rounding more is for the second order, and for what is
/// rounded of the magnitudes and of this bound.
const fn after_roundings(count: u32) -> f64 {
    (count + 1) as f64 * ROUNDOFF
}

/// For the side of an edge, seen along an axis: two numbers become doubles, their product, the sum of two of them.
pub(crate) const CROSSING_ROUNDING: f64 = after_roundings(4);

/// For the height of a point over a plane: a normal's component and a difference become doubles, their product, two
/// additions.
pub(crate) const HEIGHT_ROUNDING: f64 = after_roundings(5);

/// For the height of a point of the grid over a triangle, whose normal and differences are doubles: a product, two
/// additions.
pub(crate) const TRIANGLE_HEIGHT_ROUNDING: f64 = after_roundings(3);

// A triangle's normal is `B^2` at most, and is made of products of this size.
const _: () = assert!(2 * MAX_BITS as u32 <= f64::MANTISSA_DIGITS);

/// For how much farther a plane is from a cube's centre than the cube reaches: as the height of a corner with
/// differences that are doubles (a normal's component becomes one, a product, two additions) less as much again.
pub(crate) const CUBE_ROUNDING: f64 = after_roundings(5);

/// For whether a plane misses the point of three others. Normals' components become doubles; directions are made of two
/// of these by a product and a subtraction (4), offsets of one by a product and two additions (4), the determinant of a
/// direction and one (8). The point has a product of offset and direction, and an addition (10); the scalar product
/// with a normal has one more conversion and product, and two additions (14), from which offset times determinant is
/// taken away (15).
pub(crate) const RANK_ROUNDING: f64 = after_roundings(15);

/// For where a line of a lattice meets a triangle's plane, as a share of what its terms' magnitudes are twice at most.
/// A slope takes two conversions and two divisions, its product with a distance one more rounding; so do steps of the
/// slope, and another one for their number. Three additions are after these.
pub(crate) const LATTICE_ROUNDING: f64 = 2.0 * after_roundings(9);

/// Most that a double which stands for the coordinate of a point differs from it, in steps of the grid: eight roundings
/// of the largest coordinate.
///
/// A point of three planes is the quotient of two wide numbers, each of which becomes a double: three roundings. The
/// mean of three of these is off by as much, by a third of two roundings of sums, of `2 B` and `3 B`, and by that of
/// the quotient: less than six in all. (Where wide numbers are cut off and not rounded, which is worth two roundings,
/// five and less than eight.)
///
/// Invariant: such doubles are off by less than this, since points lie within the grid. All that is decided by them
/// first (`ExactPlane::side`, `ExactPoint::compare`, `turn`) compares with some times this, and believes what is
/// farther apart: beyond the grid the answers would be wrong, and not just slow.
pub(crate) const POINT_ERROR: f64 = 8.0 * ROUNDOFF * (1u64 << MAX_BITS) as f64;

const _: () = assert!(POINT_ERROR == 1.0 / (1 << 24) as f64);

/// Difference of two such doubles from which on the points are in this order.
pub(crate) const ORDER_ERROR: f64 = 2.0 * POINT_ERROR;

/// The most that twice the area of a triangle of such points is off by, for each step of the coordinates' differences,
/// and once more: each difference is off by twice the error and a rounding, and is multiplied with the other's;
/// products and their difference are rounded by a quarter of it.
pub(crate) const TURN_ERROR: f64 = 4.0 * POINT_ERROR;

/// The most that the height of such a point over a plane is off by, for each unit of the normal's components: by the
/// error, and by roundings of at most `3 B` in the offset, of `B` twice in each product, and of at most `3 B` in each
/// of three sums: eighteen, or two and a quarter of the errors more. (Of a point that is found in a plane along its
/// main axis, the third coordinate is off by half as much again.)
pub(crate) const SIDE_ERROR: f64 = 8.0 * POINT_ERROR;

/// Distance, in steps, from which on such doubles are apart for certain, whatever they were made from: by twice the
/// error, and what is rounded when it is added.
pub(crate) const MARGIN: f64 = 16.0 * POINT_ERROR;

/// For the turn of an edge around a line, of a way and differences that are doubles: two products and a subtraction for each component of
/// the vector product, a product with the way, two additions; and three more in the sum of the magnitudes.
pub(crate) const TURN_ROUNDING: f64 = after_roundings(5 + 3);

// Differences of the line's ends and points of the grid are doubles.
const _: () = assert!(LINE_BITS as u32 + 2 <= f64::MANTISSA_DIGITS);

/// For the share of a line at which it enters a box, and that at which it meets a face: quotients of whole numbers, of
/// which those of faces become doubles first; four roundings in all, and one when this is added. (What comes behind,
/// from shares of a part to those of the whole line, keeps the order of doubles.)
pub(crate) const SHARE_ROUNDING: f64 = after_roundings(5);

/// For the square of a face's distance, as a share of it, so that the distance of the box around it is none the
/// greater: each coordinate of the way to the nearest point of an edge takes some fifteen roundings, and the square of
/// its length twice as many and three more.
///
/// Between edges it may be off by more, in proportion to the distance of the farthest corner: of two faces that are as
/// near to each other, either may be taken for the nearest.
pub(crate) const DISTANCE_ROUNDING: f64 = 1.0 / (1u64 << 40) as f64;

const _: () = assert!(DISTANCE_ROUNDING > after_roundings(2 * 15 + 3));

/// For the share of a cell that is inside, as a sum of parts as large as a cell: less than what eight additions are
/// rounded by is nothing.
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

    /// Doubles that stand for points of the largest coordinates and weights are no farther off than they may be.
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
            // Just below a whole number near the grid's end, and anywhere.
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
                // Both by 2^53: a double from 2^-1 on is a whole number then.
                let scaled: I512 = (near * (1u64 << 53) as f64).as_();
                let off: I512 = scaled * weight.as_::<I512>() - (at.as_::<I512>() << 53u32);
                let off = off.as_::<f64>().abs() / weight.as_::<f64>() / (1u64 << 53) as f64;
                most = most.max(off);
            }
        }
        assert!(most < POINT_ERROR / 2.0, "{most}");
        assert!(most > POINT_ERROR / 16.0, "{most}: the bound is not much too large");
    }

    /// One unit decides about points beside the largest planes, with the most bits behind the point.
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
            // A corner, or a point near the plane, and a few of the least parts beside it.
            let [p, q, r] = corners;
            let share = i64::from(next() as u32 >> 1);
            let at = [0, 1, 2].map(|axis| {
                let [p, q, r] = [p, q, r].map(|corner| i64::from(corner[axis]) << FINE_BITS);
                let beside = (next() % 3) as i64 - 1;
                p + ((i128::from(q - p) * i128::from(share)) >> 33) as i64
                    + (r - p) / 4 * (share & 1)
                    + beside
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

    /// Sums of products that are rounded as often as is said are never farther off, and some are nearly.
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

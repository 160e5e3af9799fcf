//! Intersection of a triangle or an edge with an octant: exact, in integers.
//!
//! Separating axes: two convex bodies, one of them open, are disjoint if and only if they are on
//! different sides of a plane that both may touch. It is sufficient to test planes that are
//! parallel to a side of one body or to an edge of each. A box and a triangle have thirteen
//! directions: three axes, the triangle's normal, and nine pairs of an axis and an edge.

use std::ops::{Add, Mul, Sub};

use super::intersection::{Intersection, Stage};
use crate::exact::bounds::CUBE_ROUNDING;
use crate::exact::vector::{cross, dot, subtract};

/// Integer types: 64 bits if the operands are small enough, 128 bits otherwise.
trait Integer:
    Copy + Ord + Default + From<i64> + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self>
{
}
impl Integer for i64 {}
impl Integer for i128 {}

/// Operands of [`misses_edge`] below this do not overflow 64 bits: an edge is below 2^31, its
/// product with a coordinate below 2^61, and two of these are added.
const SMALL_FOR_EDGES: i64 = 1 << 30;
const _: () = assert!(2 * (2 * SMALL_FOR_EDGES as i128) * (SMALL_FOR_EDGES as i128) <= 1 << 63);
/// Limit of coordinates for [`misses_plane`], likewise: a component of the normal is below 2^41,
/// its product with a coordinate below 2^60, and three of these are added.
const SMALL_FOR_PLANE: i64 = 1 << 19;
const _: () = assert!(3 * (8 * (SMALL_FOR_PLANE as i128).pow(2)) * (SMALL_FOR_PLANE as i128) <= 1 << 63);

/// Returns whether a triangle shares a point with the interior of the box from `min` to `max`.
///
/// The triangle includes its edges and vertices, the box excludes its walls. So a triangle that
/// only touches a wall, an edge or a corner of the box, or is in a wall, does not cut it. A
/// triangle without area is treated as the segment or point that it is. Coordinates are at most
/// 2^31 in magnitude, and `min` is less than `max` on each axis.
#[inline]
pub fn cuts(triangle: &[[i64; 3]; 3], min: [i64; 3], max: [i64; 3]) -> bool {
    intersect(triangle, min, max).cuts
}

/// Tests the same as [`cuts`], and also returns the deciding stage: the fast path of
/// [`GridPolygon::cuts`](super::GridPolygon::cuts). The tests of bounds, vertices and plane are the
/// same; separating axes across the edges replace the section.
#[inline]
pub fn intersect(triangle: &[[i64; 3]; 3], min: [i64; 3], max: [i64; 3]) -> Intersection {
    let decided = |stage, cuts| Intersection { cuts, stage };
    let Some(size) = size_if_boxes_meet(triangle, min, max) else { return decided(Stage::Boxes, false) };
    // Relative to the box, coordinates are at most 2^32: sums of a few products of three fit into
    // 128 bits.
    let corners = triangle.map(|corner| subtract(corner, min));
    if corners.iter().any(|&corner| is_inside(corner, size)) {
        return decided(Stage::Vertices, true);
    }
    let reach = reach(&corners, size);
    let misses_plane = if reach < SMALL_FOR_PLANE {
        misses_plane::<i64>(&corners, size)
    } else {
        misses_plane::<i128>(&corners, size)
    };
    if misses_plane {
        return decided(Stage::Planes, false);
    }
    let [a, b, c] = corners;
    // Both ends of an edge project to one point along any direction across the edge.
    let edges = [(subtract(b, a), [a, c]), (subtract(c, b), [b, a]), (subtract(a, c), [c, b])];
    let misses_edge = if reach < SMALL_FOR_EDGES {
        edges.iter().any(|(edge, points)| misses_edge::<i64, 2>(*edge, points, size))
    } else {
        edges.iter().any(|(edge, points)| misses_edge::<i128, 2>(*edge, points, size))
    };
    decided(Stage::Section, !misses_edge)
}

/// Intersects a triangle, relative to a cube's centre, with the interior of the cube of half width
/// `half`. These are the last tests of [`intersect`], for overlapping bounds and no vertex inside.
/// `normal` is a multiple of the triangle's normal, with components below 2^62; coordinates and
/// widths are below 2^29.
#[inline]
pub(crate) fn intersect_cube(corners: &[[i64; 3]; 3], normal: [i64; 3], half: i64) -> Intersection {
    let decided = |stage, cuts| Intersection { cuts, stage };
    let [a, b, c] = *corners;
    // Most planes are clearly apart from the cube or clearly cut it, which doubles decide.
    let heights = [0, 1, 2].map(|axis| normal[axis] as f64 * a[axis] as f64);
    let reaches = normal.map(|n| n.abs() as f64 * half as f64);
    let (height, reach) = (heights[0] + heights[1] + heights[2], reaches[0] + reaches[1] + reaches[2]);
    let beyond = height.abs() - reach;
    let most = heights[0].abs() + heights[1].abs() + heights[2].abs() + reach;
    let misses_plane = if beyond.abs() > most * CUBE_ROUNDING {
        beyond > 0.0
    } else {
        let height = dot(normal.map(i128::from), a.map(i128::from));
        height.abs() >= normal.iter().map(|n| i128::from(n.abs()) * i128::from(half)).sum()
    };
    if misses_plane {
        return decided(Stage::Planes, false);
    }
    // Both ends of an edge project to one point along any direction across the edge.
    let misses_edge = [(subtract(b, a), a, c), (subtract(c, b), b, a), (subtract(a, c), c, b)].iter().any(
        |(edge, end, other)| {
            [(1, 2), (2, 0), (0, 1)].into_iter().any(|(j, k)| {
                let reach = half * (edge[j].abs() + edge[k].abs());
                let [one, two] = [end, other].map(|p| edge[j] * p[k] - edge[k] * p[j]);
                // An edge along the axis defines no direction.
                reach > 0 && ((one >= reach && two >= reach) || (one <= -reach && two <= -reach))
            })
        },
    );
    decided(Stage::Section, !misses_edge)
}

/// Returns whether the segment between two points shares a point with the interior of the box from
/// `min` to `max`, as in [`cuts`].
#[inline]
pub(crate) fn segment_cuts(a: [i64; 3], b: [i64; 3], min: [i64; 3], max: [i64; 3]) -> bool {
    let Some(size) = size_if_boxes_meet(&[a, b], min, max) else { return false };
    let (a, b) = (subtract(a, min), subtract(b, min));
    if reach(&[a, b], size) < SMALL_FOR_EDGES {
        !misses_edge::<i64, 1>(subtract(b, a), &[a], size)
    } else {
        !misses_edge::<i128, 1>(subtract(b, a), &[a], size)
    }
}

/// Returns the box's size, unless one of its walls separates it from all points: three axes.
#[inline]
fn size_if_boxes_meet(points: &[[i64; 3]], min: [i64; 3], max: [i64; 3]) -> Option<[i64; 3]> {
    for axis in 0..3 {
        debug_assert!(min[axis] < max[axis]);
        if points.iter().all(|p| p[axis] <= min[axis]) || points.iter().all(|p| p[axis] >= max[axis]) {
            return None;
        }
    }
    Some(subtract(max, min))
}

/// Returns whether the triangle's plane separates it from the interior of the box from 0 to `size`:
/// one direction.
#[inline]
fn misses_plane<I: Integer>(&[a, b, c]: &[[i64; 3]; 3], size: [i64; 3]) -> bool {
    let (u, v) = (subtract(b, a).map(I::from), subtract(c, a).map(I::from));
    let normal = cross(u, v);
    let zero = I::default();
    let (mut low, mut high, mut plane) = (zero, zero, zero);
    for axis in 0..3 {
        let far = normal[axis] * I::from(size[axis]);
        low = low + far.min(zero);
        high = high + far.max(zero);
        plane = plane + normal[axis] * I::from(a[axis]);
    }
    // A triangle without area has no normal: `low` equals `high`, and the test decides nothing.
    low < high && (plane <= low || plane >= high)
}

/// Returns whether a plane along an edge and one of the axes separates all points from the interior
/// of the box from 0 to `size`: three directions. `points` has one end of the edge, and the other
/// vertices of the body.
#[inline]
fn misses_edge<I: Integer, const N: usize>(edge: [i64; 3], points: &[[i64; 3]; N], size: [i64; 3]) -> bool {
    let zero = I::default();
    for (j, k) in [(1, 2), (2, 0), (0, 1)] {
        let (across_j, across_k) = (zero - I::from(edge[k]), I::from(edge[j]));
        let (far_j, far_k) = (across_j * I::from(size[j]), across_k * I::from(size[k]));
        let low = far_j.min(zero) + far_k.min(zero);
        let high = far_j.max(zero) + far_k.max(zero);
        let projections = points.map(|p| across_j * I::from(p[j]) + across_k * I::from(p[k]));
        // An edge along the axis defines no direction: `low` equals `high`, and the test decides
        // nothing.
        if low < high && (projections.iter().all(|&p| p <= low) || projections.iter().all(|&p| p >= high)) {
            return true;
        }
    }
    false
}

/// Returns an upper bound of all coordinates' magnitudes, less than twice the largest.
#[inline]
fn reach(points: &[[i64; 3]], size: [i64; 3]) -> i64 {
    points.iter().flatten().chain(&size).fold(0, |all, number| all | number.abs())
}

#[inline]
fn is_inside(point: [i64; 3], size: [i64; 3]) -> bool {
    (0..3).all(|axis| 0 < point[axis] && point[axis] < size[axis])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Clips the convex polygon to the box's six half-spaces, in homogeneous coordinates, and
    /// checks whether the remainder is in a wall: a convex subset of a closed box without a point
    /// of the open box is in one of its walls.
    fn cuts_by_clipping(points: &[[i64; 3]], min: [i64; 3], max: [i64; 3]) -> bool {
        let mut polygon: Vec<[i128; 4]> =
            points.iter().map(|p| [p[0].into(), p[1].into(), p[2].into(), 1]).collect();
        let walls =
            (0..3).flat_map(|axis| [(axis, 1, i128::from(min[axis])), (axis, -1, i128::from(max[axis]))]);
        let height = |p: &[i128; 4], (axis, sign, at): (usize, i128, i128)| sign * (p[axis] - at * p[3]);
        for wall in walls.clone() {
            let mut kept = Vec::new();
            for (i, p) in polygon.iter().enumerate() {
                let q = &polygon[(i + 1) % polygon.len()];
                let (hp, hq) = (height(p, wall), height(q, wall));
                if hp >= 0 {
                    kept.push(*p);
                }
                if hp.signum() * hq.signum() < 0 {
                    let mut cut = [0, 1, 2, 3].map(|i| hp.abs() * q[i] + hq.abs() * p[i]);
                    let divisor = cut.iter().fold(0, |a, &b| gcd(a, b));
                    cut.iter_mut().for_each(|x| *x /= divisor);
                    kept.push(cut);
                }
            }
            polygon = kept;
        }
        walls.clone().all(|wall| polygon.iter().any(|p| height(p, wall) > 0))
    }

    fn gcd(a: i128, b: i128) -> i128 {
        if b == 0 { a.abs() } else { gcd(b, a % b) }
    }

    /// A fixed pseudo-random sequence of numbers below `below` in magnitude.
    fn numbers(mut state: u64) -> impl FnMut(i64) -> i64 {
        move |below| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            ((state >> 33) as i64).rem_euclid(2 * below - 1) - (below - 1)
        }
    }

    const MIN: [i64; 3] = [0; 3];
    const MAX: [i64; 3] = [4; 3];

    #[test]
    fn touching_is_not_cutting() {
        let in_wall = [[0, 1, 1], [0, 3, 1], [0, 1, 3]];
        let along_edge = [[0, 0, 1], [0, 0, 3], [-2, -1, 2]];
        let at_corner = [[4, 4, 4], [6, 4, 5], [4, 6, 5]];
        let edge_on_corner = [[8, 4, 0], [0, 4, 8], [9, 9, 9]];
        let plane_on_corner = [[-9, 9, 0], [9, -9, 0], [0, 0, -9]];
        let across_an_edge = [[-1, 1, 2], [1, -1, 2], [-1, -1, 7]];
        for triangle in [in_wall, along_edge, at_corner, edge_on_corner, plane_on_corner, across_an_edge] {
            assert!(!cuts(&triangle, MIN, MAX), "{triangle:?}");
            assert!(!cuts_by_clipping(&triangle, MIN, MAX), "{triangle:?}");
        }
    }

    #[test]
    fn every_way_to_cut() {
        let corner_inside = [[2, 2, 2], [9, 2, 2], [9, 9, 2]];
        let all_inside = [[1, 1, 1], [3, 1, 1], [1, 3, 2]];
        let edge_through = [[-2, 2, 2], [6, 2, 2], [2, 2, 20]];
        let around_everything = [[-90, -90, 2], [90, -90, 2], [0, 90, 2]];
        let corners_on_walls = [[0, 2, 2], [4, 2, 2], [2, 4, 3]];
        let through_two_edges = [[0, 0, 2], [4, 4, 2], [9, 0, 2]];
        for triangle in
            [corner_inside, all_inside, edge_through, around_everything, corners_on_walls, through_two_edges]
        {
            assert!(cuts(&triangle, MIN, MAX), "{triangle:?}");
            assert!(cuts_by_clipping(&triangle, MIN, MAX), "{triangle:?}");
        }
    }

    #[test]
    fn without_area_it_is_a_segment_or_a_point() {
        assert!(cuts(&[[2; 3]; 3], MIN, MAX));
        assert!(!cuts(&[[4, 2, 2]; 3], MIN, MAX));
        assert!(cuts(&[[-1, -1, -1], [9, 9, 9], [3, 3, 3]], MIN, MAX));
        assert!(cuts(&[[-1, -1, -1], [9, 9, 9], [-1, -1, -1]], MIN, MAX));
        assert!(!cuts(&[[-2, 0, 2], [2, 0, 2], [8, 0, 2]], MIN, MAX));
        assert!(!cuts(&[[-2, 2, 2], [2, -2, 2], [0, 0, 2]], MIN, MAX));
    }

    #[test]
    fn triangles_and_segments_agree_with_clipping() {
        let mut number = numbers(1);
        let mut counts = [0; 2];
        for round in 0..60_000 {
            // Small ranges touch often, larger ones are the general case.
            let range = [4, 6, 12, 200][round % 4];
            let mut point = |range| [number(range), number(range), number(range)];
            let triangle = [point(range), point(range), point(range)];
            let min = point(range / 2);
            let size = point(range / 2).map(|x| x.abs() + 1);
            let max = [0, 1, 2].map(|i| min[i] + size[i]);
            let expected = cuts_by_clipping(&triangle, min, max);
            assert_eq!(cuts(&triangle, min, max), expected, "{triangle:?} {min:?} {max:?}");
            counts[usize::from(expected)] += 1;
            let [a, b, _] = triangle;
            let expected = cuts_by_clipping(&[a, b], min, max);
            assert_eq!(segment_cuts(a, b, min, max), expected, "{a:?} {b:?} {min:?} {max:?}");
        }
        assert!(counts.iter().all(|&times| times > 6_000), "{counts:?}");
    }

    /// All integer widths give the same results, up to the largest allowed coordinates.
    #[test]
    fn scale_does_not_matter() {
        let mut number = numbers(2);
        for _ in 0..4_000 {
            let mut point = |range| [number(range), number(range), number(range)];
            let triangle = [point(5), point(5), point(5)];
            let min = point(3);
            let max = [0, 1, 2].map(|i| min[i] + 1 + triangle[0][i].abs() % 3);
            let expected = cuts(&triangle, min, max);
            for scale in [1 << 17, 1 << 18, 1 << 27, 1 << 28, 1 << 29] {
                let scaled = |p: [i64; 3]| p.map(|x| x * scale);
                let triangle = triangle.map(scaled);
                assert_eq!(
                    cuts(&triangle, scaled(min), scaled(max)),
                    expected,
                    "{triangle:?} {min:?} {max:?}"
                );
                let [a, b, _] = triangle;
                let segment = cuts(&[a, b, b], scaled(min), scaled(max));
                assert_eq!(segment_cuts(a, b, scaled(min), scaled(max)), segment, "{a:?} {b:?}");
            }
        }
    }

    /// One unit decides at the far ends of the grid.
    #[test]
    fn one_unit_decides_at_any_size() {
        let far = 1 << 31;
        // The plane x + y = -2 far + 2 cuts off one unit of the corner, and the next one touches
        // it.
        let plane = |at: i64| [[-far, at, -far], [at, -far, -far], [-far + at / 2, at - at / 2, far]];
        let box_at = |side: i64| ([-far; 3], [-far + side; 3]);
        for side in [1, 2, 1 << 20, 2 * far] {
            let (min, max) = box_at(side);
            assert!(cuts(&plane(-far + 1), min, max), "{side}");
            assert!(!cuts(&plane(-far), min, max), "{side}");
        }
        let through = [[-far, -far, -far], [far, far, far], [far, far, far - 1]];
        assert!(cuts(&through, [far - 1; 3], [far; 3]));
        assert!(cuts(&through, [-1; 3], [0; 3]));
        assert!(!cuts(&through, [-1, 0, -1], [0, 1, 0]));
    }
}

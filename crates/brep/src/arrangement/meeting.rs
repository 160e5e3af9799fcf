//! Exact common points of two triangles.

use std::cmp::Ordering;

use super::point::{ExactPlane, ExactPoint, cross};
use crate::exact::vector::{main_axis, others};
use crate::face_triangle::FaceTriangle;

/// Common points of two triangles.
#[derive(Clone, Copy, Debug)]
pub(super) enum Meeting {
    /// No points; or, in one plane, only sections of both boundaries.
    Nothing,
    /// A shared vertex, as between neighbours in a surface.
    SharedVertex(ExactPoint),
    /// A shared edge of both faces, as between neighbours in a surface.
    SharedEdge([ExactPoint; 2]),
    /// Another point, of triangles in different planes.
    Point(ExactPoint),
    /// Another segment, of triangles in different planes.
    Segment([ExactPoint; 2]),
    /// More than neighbours have, in the plane of both.
    InPlane,
}

/// Returns the common points of two triangles with an area, which lie in these planes.
pub(super) fn meet(
    a: &FaceTriangle,
    plane_a: &ExactPlane,
    b: &FaceTriangle,
    plane_b: &ExactPlane,
) -> Meeting {
    let heights_b = b.corners.map(|corner| plane_a.height(corner));
    if are_on_one_side(&heights_b) {
        return Meeting::Nothing;
    }
    let mut shared = (0..9).map(|pair| (pair / 3, pair % 3)).filter(|&(i, j)| a.corners[i] == b.corners[j]);
    let shared = [shared.next(), shared.next(), shared.next()];
    if heights_b == [0; 3] {
        return if is_disjoint_in_plane(a, b, plane_a.main_axis(), shared) {
            Meeting::Nothing
        } else {
            Meeting::InPlane
        };
    }
    if let [Some(one), Some(other), _] = shared {
        // Different planes have only the edge's line in common.
        let ends = [one, other].map(|(i, _)| ExactPoint::of_grid(a.corners[i]));
        let is_edge = is_boundary(a, one.0, other.0) && is_boundary(b, one.1, other.1);
        return if is_edge { Meeting::SharedEdge(ends) } else { Meeting::Segment(ends) };
    }
    let heights_a = a.corners.map(|corner| plane_b.height(corner));
    if are_on_one_side(&heights_a) {
        return Meeting::Nothing;
    }
    // Each triangle meets the common line of both planes in an interval.
    let along = cross(plane_a.normal, plane_b.normal);
    let axis = main_axis(along);
    // Invariant: both triangles have points on the common line. Neither has all vertices on one
    // side of the other's plane, or in it (the planes would be equal). `interval` requires that.
    let ([low_a, high_a], [low_b, high_b]) =
        (interval(&a.corners, &heights_a, axis), interval(&b.corners, &heights_b, axis));
    let low = if low_a.compare(&low_b, axis) == Ordering::Less { low_b } else { low_a };
    let high = if high_a.compare(&high_b, axis) == Ordering::Greater { high_b } else { high_a };
    match low.compare(&high, axis) {
        Ordering::Greater => Meeting::Nothing,
        Ordering::Less => Meeting::Segment([low, high]),
        // (If the triangles share a vertex, that is the point.)
        Ordering::Equal if shared[0].is_some() => Meeting::SharedVertex(low),
        Ordering::Equal => Meeting::Point(low),
    }
}

fn are_on_one_side(heights: &[i128; 3]) -> bool {
    heights.iter().all(|height| *height > 0) || heights.iter().all(|height| *height < 0)
}

/// Whether the edge between two vertices is an edge of the face.
fn is_boundary(triangle: &FaceTriangle, one: usize, other: usize) -> bool {
    !triangle.internal[if (one + 1) % 3 == other { one } else { other }]
}

/// Returns the ends, along an axis, of a triangle's intersection with a plane. `heights` are the
/// vertices' heights over the plane: not all on one side, and not all 0.
fn interval(corners: &[[i32; 3]; 3], heights: &[i128; 3], axis: usize) -> [ExactPoint; 2] {
    let mut ends: Option<[ExactPoint; 2]> = None;
    for i in 0..3 {
        let j = (i + 1) % 3;
        let found = if heights[i] == 0 {
            ExactPoint::of_grid(corners[i])
        } else if heights[j] != 0 && (heights[i] > 0) != (heights[j] > 0) {
            ExactPoint::of_edge([corners[i], corners[j]], [heights[i], heights[j]])
        } else {
            continue;
        };
        ends = Some(match ends {
            None => [found; 2],
            Some([low, high]) if found.compare(&low, axis) == Ordering::Less => [found, high],
            Some([low, high]) if found.compare(&high, axis) == Ordering::Greater => [low, found],
            Some(ends) => ends,
        });
    }
    ends.unwrap_or_else(|| unreachable!("triangles with corners on both sides of a plane meet it"))
}

/// Whether two triangles of one plane, seen along an axis, have no more in common than neighbours
/// have.
fn is_disjoint_in_plane(
    a: &FaceTriangle,
    b: &FaceTriangle,
    axis: usize,
    shared: [Option<(usize, usize)>; 3],
) -> bool {
    let [u, v] = others(axis);
    let flat = |corner: [i32; 3]| [i64::from(corner[u]), i64::from(corner[v])];
    let turn = |p: [i64; 2], q: [i64; 2], r: [i64; 2]| {
        let along = [q[0] - p[0], q[1] - p[1]].map(i128::from);
        let to = [r[0] - p[0], r[1] - p[1]].map(i128::from);
        (along[0] * to[1] - along[1] * to[0]).signum() as i32
    };
    // Both counterclockwise; vertices keep their numbers.
    let order = |corners: &[[i32; 3]; 3]| {
        let [p, q, r] = corners.map(flat);
        if turn(p, q, r) > 0 { [0, 1, 2] } else { [0, 2, 1] }
    };
    let sides = [(a, b, false), (b, a, true)];
    match shared {
        [None, ..] => sides.iter().any(|(one, other, _)| {
            let way = order(&one.corners);
            (0..3).any(|i| {
                let (p, q) = (flat(one.corners[way[i]]), flat(one.corners[way[(i + 1) % 3]]));
                other.corners.iter().all(|corner| turn(p, q, flat(*corner)) < 0)
            })
        }),
        [Some(common), None, _] => sides.iter().any(|(one, other, is_turned)| {
            let way = order(&one.corners);
            let (own, its) = if *is_turned { (common.1, common.0) } else { common };
            let corner = flat(one.corners[own]);
            // (Only an edge that ends in the shared vertex can separate the triangles: the third
            // edge has that vertex on its inner side.)
            let mut edges =
                (0..3).map(|i| (way[i], way[(i + 1) % 3])).filter(|(from, to)| [*from, *to].contains(&own));
            edges.any(|(from, to)| {
                let (p, q) = (flat(one.corners[from]), flat(one.corners[to]));
                (0..3).filter(|k| *k != its).all(|k| {
                    let point = flat(other.corners[k]);
                    match turn(p, q, point) {
                        // On the line of such an edge, but on the other side of the shared vertex.
                        0 => {
                            let far = if from == own { q } else { p };
                            let along = |at: [i64; 2]| [at[0] - corner[0], at[1] - corner[1]].map(i128::from);
                            let (far, there) = (along(far), along(point));
                            far[0] * there[0] + far[1] * there[1] < 0
                        }
                        side => side < 0,
                    }
                })
            })
        }),
        [Some(one), Some(other), None] => {
            let third = |i: usize, j: usize| 3 - i - j;
            let (p, q) = (flat(a.corners[one.0]), flat(a.corners[other.0]));
            let apexes = [a.corners[third(one.0, other.0)], b.corners[third(one.1, other.1)]];
            let [first, second] = apexes.map(|apex| turn(p, q, flat(apex)));
            first != second && is_boundary(a, one.0, other.0) && is_boundary(b, one.1, other.1)
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exact::normal::ring_normal;

    fn of(a: [[i32; 3]; 3], b: [[i32; 3]; 3]) -> Meeting {
        let plane = |corners: &[[i32; 3]; 3]| ExactPlane::through(corners[0], ring_normal(corners));
        let triangle = |corners| FaceTriangle { corners, internal: [false; 3] };
        let found = meet(&triangle(a), &plane(&a), &triangle(b), &plane(&b));
        // The result does not depend on the order of the triangles, on the first vertex, or on the
        // orientation.
        let [p, q, r] = b;
        let again = meet(&triangle([q, p, r]), &plane(&[q, p, r]), &triangle(a), &plane(&a));
        match (&found, &again) {
            (Meeting::Point(one), Meeting::Point(other))
            | (Meeting::SharedVertex(one), Meeting::SharedVertex(other)) => {
                assert!(one.is(other));
            }
            (Meeting::Segment(one), Meeting::Segment(other))
            | (Meeting::SharedEdge(one), Meeting::SharedEdge(other)) => {
                assert!(
                    one[0].is(&other[0]) && one[1].is(&other[1])
                        || one[0].is(&other[1]) && one[1].is(&other[0])
                );
            }
            _ => assert_eq!(std::mem::discriminant(&found), std::mem::discriminant(&again)),
        }
        found
    }

    const A: [[i32; 3]; 3] = [[0, 0, 0], [8, 0, 0], [0, 8, 0]];

    #[test]
    fn neighbours_are_regular() {
        let others = [
            [[8, 0, 0], [0, 0, 0], [0, -8, 3]],
            [[8, 0, 0], [0, 0, 0], [0, -8, 0]],
            [[0, 0, 0], [-8, 0, 1], [0, -8, 1]],
            [[0, 0, 0], [-8, 0, 0], [0, -8, 0]],
            [[0, 0, 0], [-8, 8, 0], [-8, -8, 0]],
            [[20, 0, 1], [28, 0, -1], [20, 8, 1]],
            [[20, 0, 0], [28, 0, 0], [20, 8, 0]],
        ];
        for b in others {
            let is_regular =
                matches!(of(A, b), Meeting::Nothing | Meeting::SharedVertex(_) | Meeting::SharedEdge(_));
            assert!(is_regular, "{b:?}");
        }
    }

    #[test]
    fn what_is_common_is_found() {
        let segment = |b, ends: [[i32; 3]; 2]| match of(A, b) {
            Meeting::Segment(found) => {
                let mut found = found.map(|point| point.rounded());
                found.sort_unstable();
                assert_eq!(found, ends, "{b:?}");
            }
            other => panic!("{b:?}: {other:?}"),
        };
        segment([[1, 1, -2], [5, 1, -2], [3, 1, 4]], [[2, 1, 0], [4, 1, 0]]);
        segment([[4, -2, -2], [4, 2, -2], [4, 0, 9]], [[4, 0, 0], [4, 2, 0]]);
        // From a shared vertex; along a section of an edge; in the plane's edge from outside.
        segment([[0, 0, 0], [6, 6, 6], [6, 6, -6]], [[0, 0, 0], [4, 4, 0]]);
        segment([[2, 0, 0], [12, 0, 0], [2, 0, 5]], [[2, 0, 0], [8, 0, 0]]);
        let point = |b, at: [i32; 3]| match of(A, b) {
            Meeting::Point(found) => assert_eq!(found.rounded(), at, "{b:?}"),
            other => panic!("{b:?}: {other:?}"),
        };
        point([[2, 2, 0], [3, 1, 5], [1, 1, 5]], [2, 2, 0]);
        point([[2, -3, -3], [2, 3, 3], [2, -9, 9]], [2, 0, 0]);
        for b in [
            A,
            [[0, 0, 0], [0, 8, 0], [8, 0, 0]],
            [[0, 0, 0], [2, 0, 0], [0, 2, 0]],
            [[0, 0, 0], [2, 1, 0], [1, 2, 0]],
            [[0, 0, 0], [-1, 9, 0], [1, 9, 0]],
            [[1, 1, 0], [9, 1, 0], [1, 9, 0]],
            [[2, 0, 0], [6, 0, 0], [4, -3, 0]],
            [[8, 0, 0], [16, 0, 0], [0, 4, 0]],
            [[0, 0, 0], [4, 0, 0], [4, -3, 0]],
        ] {
            assert!(matches!(of(A, b), Meeting::InPlane), "{b:?}");
        }
    }

    /// A fraction with a positive denominator.
    #[derive(Clone, Copy, Debug)]
    struct Fraction(i128, i128);

    impl Fraction {
        fn of(numerator: i128, denominator: i128) -> Fraction {
            Fraction(numerator * denominator.signum(), denominator.abs())
        }

        fn order(self, other: Fraction) -> Ordering {
            (self.0 * other.1).cmp(&(other.0 * self.1))
        }
    }

    fn dot(a: [i128; 3], b: [i128; 3]) -> i128 {
        (0..3).map(|axis| a[axis] * b[axis]).sum()
    }

    fn product(a: [i128; 3], b: [i128; 3]) -> [i128; 3] {
        [0, 1, 2].map(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
    }

    /// The line of two planes `a x + b y + c z + d = 0` by table 2 and formula (6) of "Construction
    /// of the spatial intersection line of polygon meshes" (2012): a point times a nonzero
    /// coordinate of the direction, that coordinate, and the direction.
    fn line_of([one, other]: [([i128; 3], i128); 2]) -> Option<([i128; 3], i128, [i128; 3])> {
        let ((n1, d1), (n2, d2)) = (one, other);
        let along = product(n1, n2);
        // The point's coordinate on that axis is set to 0. (The first row of the printed table
        // solves for y0 and z0 where z0 is zero.)
        let zero = (0..3).find(|axis| along[*axis] != 0)?;
        let [u, v] = [(zero + 1) % 3, (zero + 2) % 3];
        let mut base = [0; 3];
        base[u] = n1[v] * d2 - n2[v] * d1;
        base[v] = n2[u] * d1 - n1[u] * d2;
        Some((base, along[zero], along))
    }

    /// Conditions U1 and U2 of the article, in fractions, and with the vertices on the line that
    /// its criterion misses. U1: the line of two planes meets both polygons. U2: these intervals
    /// overlap.
    #[test]
    fn conditions_of_the_literature() {
        let mut state = 9u64;
        let mut number = move || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as i32 % 5
        };
        let mut counts = [0; 4];
        for _ in 0..20_000 {
            let mut triangle = || [0; 3].map(|_| [number(), number(), number()]);
            let (a, b) = (triangle(), triangle());
            let planes = [a, b].map(|corners| {
                let normal = ring_normal(&corners).map(i128::from);
                (normal, -dot(normal, corners[0].map(i128::from)))
            });
            let Some((base, times, along)) = line_of(planes) else { continue };
            for (normal, offset) in planes {
                assert_eq!(dot(normal, base) + offset * times, 0);
            }
            // Where each polygon's edges cross the line, in the frame of the line's direction, the
            // normal and their cross product.
            let part = |corners: [[i32; 3]; 3], normal: [i128; 3]| {
                let across = product(normal, along);
                let project = |corner: [i32; 3]| {
                    let from = [0, 1, 2].map(|axis| i128::from(corner[axis]) * times - base[axis]);
                    (dot(along, from), dot(across, from))
                };
                let mut positions: Vec<Fraction> = Vec::new();
                for i in 0..3 {
                    let ((x1, y1), (x2, y2)) = (project(corners[i]), project(corners[(i + 1) % 3]));
                    if y1 == 0 {
                        positions.push(Fraction::of(x1, times));
                    } else if (y1 < 0) != (y2 < 0) && y2 != 0 {
                        positions.push(Fraction::of(x1 * (y1 - y2) + (x2 - x1) * y1, (y1 - y2) * times));
                    }
                }
                positions.sort_by(|a, b| a.order(*b));
                Some([*positions.first()?, *positions.last()?])
            };
            let parts = [part(a, planes[0].0), part(b, planes[1].0)];
            let expected = match parts {
                [Some([low_a, high_a]), Some([low_b, high_b])] => {
                    let low = if low_a.order(low_b).is_lt() { low_b } else { low_a };
                    let high = if high_a.order(high_b).is_gt() { high_b } else { high_a };
                    if low.order(high).is_gt() { Err("not U2") } else { Ok([low, high]) }
                }
                _ => Err("not U1"),
            };
            let ends = match of(a, b) {
                Meeting::Nothing => None,
                Meeting::Point(point) | Meeting::SharedVertex(point) => Some([point; 2]),
                Meeting::Segment(ends) | Meeting::SharedEdge(ends) => Some(ends),
                Meeting::InPlane => unreachable!("the planes are not the same"),
            };
            match (expected, ends) {
                (Err(_), None) => {}
                (Ok([low, high]), Some(ends)) => {
                    let mut positions = ends.map(|end| {
                        let at = (0..3).map(|axis| {
                            along[axis] as f64 * (end.near[axis] - base[axis] as f64 / times as f64)
                        });
                        at.sum::<f64>()
                    });
                    positions.sort_by(f64::total_cmp);
                    for (Fraction(numerator, denominator), position) in [low, high].into_iter().zip(positions)
                    {
                        assert!(
                            (numerator as f64 / denominator as f64 - position).abs() < 1e-6,
                            "{a:?} {b:?}"
                        );
                    }
                    assert_eq!(low.order(high).is_eq(), ends[0].is(&ends[1]), "{a:?} {b:?}");
                }
                _ => panic!("{a:?} {b:?}: {expected:?} {ends:?}"),
            }
            let kind = match expected {
                Err("not U1") => 0,
                Err(_) => 1,
                Ok([low, high]) => 2 + usize::from(low.order(high).is_lt()),
            };
            counts[kind] += 1;
        }
        assert!(counts.iter().all(|count| *count > 500), "{counts:?}");
    }

    /// Row 6 of the article's table 2: a line along x, and a point of it by its formulas.
    #[test]
    fn the_line_of_two_planes() {
        // y + z = 5 and y - z = 1.
        let planes = [([0, 1, 1], -5), ([0, 1, -1], -1)];
        assert_eq!(line_of(planes), Some(([0, -6, -4], -2, [-2, 0, 0])));
        // The same for all rows: a direction along each axis, in each coordinate plane, and in
        // general position.
        let rows =
            [[[1, 0, 0], [0, 1, 1]], [[0, 1, 0], [1, 0, 1]], [[0, 0, 1], [1, 1, 0]], [[1, 2, 3], [3, -1, 2]]];
        for [n1, n2] in rows {
            let planes = [(n1, -7), (n2, 4)];
            let (base, times, along) = line_of(planes).unwrap();
            for (normal, offset) in planes {
                assert_eq!((dot(normal, base) + offset * times, dot(normal, along)), (0, 0));
            }
        }
        assert_eq!(line_of([([1, 2, 3], 0), ([-2, -4, -6], 5)]), None);
    }
}

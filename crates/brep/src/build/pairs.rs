//! Contacts of two triangles: exact, in integers.
//!
//! Faces of a body may touch along edges, in vertices, and where two bodies share a wall, with
//! opposite orientation. They must not intersect, or overlap with the same orientation.

use std::cmp::Ordering;

use super::defects::DefectKind;
use crate::exact::bounds::TRIANGLE_HEIGHT_ROUNDING;
use crate::exact::normal::ring_normal;
use crate::exact::vector::{dot, main_axis, others, subtract};
use crate::face_triangle::FaceTriangle;

pub(super) type Triangle = [[i32; 3]; 3];

/// Contact of two triangles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Contact {
    /// No defect.
    Fine,
    Wrong(DefectKind),
    /// An edge, `through`, meets another one, `across`, in a point that is inside of both. Whether
    /// that is a defect depends on the faces at the edge `across`: see [`passes`].
    Edges {
        through: [[i32; 3]; 2],
        across: [[i32; 3]; 2],
    },
}

/// The plane of a triangle.
struct Plane {
    through: [i32; 3],
    normal: [i64; 3],
}

impl Plane {
    #[inline]
    fn of(triangle: &Triangle) -> Plane {
        Plane { through: triangle[0], normal: ring_normal(triangle) }
    }

    /// Returns the side on which a point is: 1 where the triangle is counterclockwise, 0 on the
    /// plane.
    #[inline]
    fn side(&self, point: [i32; 3]) -> i32 {
        let Plane { through, normal } = self;
        let from = subtract(point.map(i64::from), through.map(i64::from));
        // The normal is an exact double; its products with a difference are rounded.
        let parts = [0, 1, 2].map(|axis| normal[axis] as f64 * from[axis] as f64);
        let sum = parts[0] + parts[1] + parts[2];
        if sum.abs() > (parts[0].abs() + parts[1].abs() + parts[2].abs()) * TRIANGLE_HEIGHT_ROUNDING {
            return if sum > 0.0 { 1 } else { -1 };
        }
        dot(normal.map(i128::from), from.map(i128::from)).signum() as i32
    }
}

/// Returns the sign of the volume of a tetrahedron: 1 if the last point is on the side from which
/// the first three are counterclockwise.
#[inline]
fn orientation(a: [i32; 3], b: [i32; 3], c: [i32; 3], d: [i32; 3]) -> i32 {
    Plane::of(&[a, b, c]).side(d)
}

/// Common vertices of two triangles: bit `3 * i + j` is set if vertex `i` of the first equals
/// vertex `j` of the second.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Shared(u16);

impl Shared {
    #[inline]
    pub(super) fn of(a: &Triangle, b: &Triangle) -> Shared {
        // (Without branches, which would be unpredictable.)
        let same = |pair: usize| u16::from(a[pair / 3] == b[pair % 3]) << pair;
        Shared((0..9).map(same).sum())
    }

    #[inline]
    fn has(self, corner_of_b: usize) -> bool {
        self.0 >> corner_of_b & 0b001_001_001 != 0
    }

    /// Returns whether at least two vertices are common.
    #[inline]
    pub(super) fn are_several(self) -> bool {
        self.0.count_ones() > 1
    }

    /// Returns the only common vertex, as the index in each triangle.
    #[inline]
    fn only(self) -> Option<(usize, usize)> {
        let pair = self.0.trailing_zeros() as usize;
        self.0.is_power_of_two().then_some((pair / 3, pair % 3))
    }

    /// Returns whether all common vertices pass a test.
    #[inline]
    pub(super) fn all(self, b: &Triangle, is_such: impl Fn([i32; 3]) -> bool) -> bool {
        self.0 == 0 || (0..3).all(|corner| !self.has(corner) || is_such(b[corner]))
    }
}

/// Returns the contact of two triangles that have an area and these common vertices.
pub(super) fn contact(first: &FaceTriangle, second: &FaceTriangle, shared: Shared) -> Contact {
    let (a, b) = (&first.corners, &second.corners);
    let plane_of_a = Plane::of(a);
    // Common vertices are on the plane.
    let side_of_b = |corner: usize| if shared.has(corner) { 0 } else { plane_of_a.side(b[corner]) };
    let of_b = [0, 1, 2].map(side_of_b);
    if of_b == [0; 3] {
        return if overlap(a, b) { Contact::Wrong(DefectKind::Overlap) } else { Contact::Fine };
    }
    if let Some(pair) = shared.only() {
        let crosses = wedges_cross(a, b, of_b, pair);
        return if crosses { Contact::Wrong(DefectKind::Crossing) } else { Contact::Fine };
    }
    // Different planes through a common edge meet only in the edge's line.
    if shared != Shared(0) || all_on_one_side(of_b) {
        return Contact::Fine;
    }
    let plane_of_b = Plane::of(b);
    let of_a = a.map(|point| plane_of_b.side(point));
    if all_on_one_side(of_a) {
        return Contact::Fine;
    }
    match edges_cross(first, second, of_b) {
        Contact::Fine => edges_cross(second, first, of_a),
        found => found,
    }
}

fn all_on_one_side(sides: [i32; 3]) -> bool {
    let [x, y, z] = sides;
    x == y && y == z && x != 0
}

/// Returns the contact of `b`'s edges with `a`; `sides` are those of `b`'s vertices.
fn edges_cross(a: &FaceTriangle, b: &FaceTriangle, sides: [i32; 3]) -> Contact {
    let mut found = Contact::Fine;
    for i in 0..3 {
        let j = (i + 1) % 3;
        if b.internal[i] || sides[i] * sides[j] >= 0 {
            continue;
        }
        let (from, to) = (b.corners[i], b.corners[j]);
        let around = [0, 1, 2].map(|k| orientation(from, to, a.corners[k], a.corners[(k + 1) % 3]));
        if all_on_one_side(around) {
            return Contact::Wrong(DefectKind::Crossing);
        }
        // Through one of its edges, between the ends.
        let Some(edge) = (0..3).find(|k| around[*k] == 0) else { continue };
        let (next, last) = (around[(edge + 1) % 3], around[(edge + 2) % 3]);
        if next != last || next == 0 {
            continue;
        }
        if a.internal[edge] {
            return Contact::Wrong(DefectKind::Crossing);
        }
        let across = [a.corners[edge], a.corners[(edge + 1) % 3]];
        found = Contact::Edges { through: [from, to], across };
    }
    found
}

/// Returns the triangle that bounds the same body at an edge: of those with the opposite edge, the
/// first one in the turn from the triangle's back around the edge. (Touching bodies have more than
/// two faces at an edge.)
pub(super) fn twin<'a>(
    one: &Triangle,
    edge: [[i32; 3]; 2],
    others: impl Iterator<Item = &'a Triangle>,
) -> Option<&'a Triangle> {
    let apex = |t: &Triangle| t.iter().copied().find(|point| !edge.contains(point)).unwrap_or(edge[0]);
    let own = apex(one);
    let normal = |c: [i32; 3]| ring_normal(&[edge[0], edge[1], c]);
    let is_opposite =
        |point: [i32; 3]| (0..3).any(|k| normal(own)[k].signum() * normal(point)[k].signum() < 0);
    // Less than half a turn, half a turn, more. A triangle that coincides with this one belongs to
    // another body.
    let turn = |point: [i32; 3]| match orientation(one[0], one[1], one[2], point) {
        side if side < 0 => Some(0),
        0 => is_opposite(point).then_some(1),
        _ => Some(2),
    };
    others.filter(|other| turn(apex(other)).is_some()).reduce(|best, other| {
        let (b, o) = (apex(best), apex(other));
        let is_first = match turn(o).cmp(&turn(b)) {
            Ordering::Equal => orientation(edge[0], edge[1], b, o) > 0,
            order => order == Ordering::Less,
        };
        if is_first { other } else { best }
    })
}

/// Returns whether an edge that meets the common edge of two triangles, in a point that is inside
/// of both edges, crosses their surface there.
pub(super) fn passes([from, to]: [[i32; 3]; 2], one: &Triangle, other: &Triangle) -> bool {
    // The surface is bent along the edge to the inside, to the outside, or not at all.
    let bend = other.iter().map(|point| orientation(one[0], one[1], one[2], *point)).find(|side| *side != 0);
    let is_inside = |point: [i32; 3]| {
        let is_below = |t: &Triangle| orientation(t[0], t[1], t[2], point) < 0;
        match bend {
            Some(-1) => is_below(one) && is_below(other),
            Some(_) => is_below(one) || is_below(other),
            None => is_below(one),
        }
    };
    // (An edge along one of the triangles is decided by other edges.)
    let is_along = |point: [i32; 3]| [one, other].iter().any(|t| orientation(t[0], t[1], t[2], point) == 0);
    !is_along(from) && !is_along(to) && is_inside(from) != is_inside(to)
}

/// Returns whether two triangles that share only vertex `i` of the one and `j` of the other
/// intersect at that vertex; `of_b` are the sides of the other's vertices.
fn wedges_cross(a: &Triangle, b: &Triangle, of_b: [i32; 3], (i, j): (usize, usize)) -> bool {
    // Each must have vertices on both sides of the other.
    let (i1, i2, j1, j2) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
    if of_b[j1] * of_b[j2] >= 0 {
        return false;
    }
    let plane_of_b = Plane::of(b);
    if plane_of_b.side(a[i1]) * plane_of_b.side(a[i2]) >= 0 {
        return false;
    }
    // From the vertex, the planes' common line enters each triangle, in the same or in opposite
    // directions. It meets the opposite edge at a mean of the edge's ends. Each end is weighted by
    // the distance of the other one from the other triangle's plane.
    let direction = |t: &Triangle, at: usize, first: usize, second: usize, other: &Triangle| {
        let height = |point: [i32; 3]| -> i128 {
            dot(ring_normal(other).map(i128::from), subtract(point.map(i128::from), other[0].map(i128::from)))
        };
        let (one, two) = (height(t[first]).abs(), height(t[second]).abs());
        [0, 1, 2].map(|k| {
            let along = |corner: usize| i128::from(t[corner][k]) - i128::from(t[at][k]);
            two * along(first) + one * along(second)
        })
    };
    let (along_a, along_b) = (direction(a, i, i1, i2, b), direction(b, j, j1, j2, a));
    (0..3).any(|k| along_a[k].signum() * along_b[k].signum() > 0)
}

/// Returns the common edges of two triangles at which they are folded flat, as the first triangle
/// traverses them: both lie in one plane, on the same side of the edge. Whether that is a defect
/// depends on the other faces at the edge: bodies that touch have such faces, and further ones.
pub(super) fn folded_edges<'a>(
    a: &'a FaceTriangle,
    b: &'a FaceTriangle,
) -> impl Iterator<Item = [[i32; 3]; 2]> + use<'a> {
    let is_opposite = || {
        let (own, other) = (ring_normal(&a.corners), ring_normal(&b.corners));
        (0..3).any(|axis| own[axis].signum() * other[axis].signum() < 0)
    };
    let is_on = |point: [i32; 3]| a.corners.contains(&point) || Plane::of(&a.corners).side(point) == 0;
    let edges = (0..3).map(|i| [a.corners[i], a.corners[(i + 1) % 3]]);
    let common = edges.filter(|[from, to]| a.bounds([*from, *to]) && b.bounds([*to, *from]));
    common.filter(move |_| b.corners.iter().all(|point| is_on(*point)) && is_opposite())
}

/// Returns whether two coplanar triangles of the same orientation share an area.
fn overlap(a: &Triangle, b: &Triangle) -> bool {
    let (normal_a, normal_b) = (ring_normal(a), ring_normal(b));
    let axis = main_axis(normal_a);
    if (normal_a[axis] > 0) != (normal_b[axis] > 0) {
        return false;
    }
    let [mut u, mut v] = others(axis);
    if normal_a[axis] < 0 {
        (u, v) = (v, u);
    }
    // Both are convex and counterclockwise in this projection: they share no area if one is beyond
    // an edge of the other.
    let beyond_an_edge = |a: &Triangle, b: &Triangle| {
        (0..3).any(|i| {
            let (p, q) = (a[i], a[(i + 1) % 3]);
            let along = [u, v].map(|axis| i64::from(q[axis]) - i64::from(p[axis]));
            b.iter().all(|point| {
                let to = [u, v].map(|axis| i64::from(point[axis]) - i64::from(p[axis]));
                along[0] * to[1] <= along[1] * to[0]
            })
        })
    };
    !beyond_an_edge(a, b) && !beyond_an_edge(b, a)
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Triangle = [[0, 0, 0], [8, 0, 0], [0, 8, 0]];

    fn both(a: &Triangle, b: &Triangle) -> Option<DefectKind> {
        let conflict = |a: &Triangle, b: &Triangle| {
            let triangle = |corners: &Triangle| FaceTriangle { corners: *corners, internal: [false; 3] };
            match contact(&triangle(a), &triangle(b), Shared::of(a, b)) {
                Contact::Wrong(kind) => Some(kind),
                _ => None,
            }
        };
        let found = conflict(a, b);
        // The order, and the start of a triangle, do not matter.
        assert_eq!(conflict(b, a), found);
        assert_eq!(conflict(&[a[1], a[2], a[0]], &[b[2], b[0], b[1]]), found);
        assert_eq!(conflict(&[a[1], a[0], a[2]], &[b[1], b[0], b[2]]), found);
        found
    }

    /// Only opposite triangles on the same side of a common edge are folded there.
    #[test]
    fn folds_are_flat_and_on_one_side() {
        let triangle = |corners: Triangle| FaceTriangle { corners, internal: [false; 3] };
        let edges = |b: Triangle| folded_edges(&triangle(A), &triangle(b)).collect::<Vec<_>>();
        let edge = [A[0], A[1]];
        assert_eq!(edges([A[1], A[0], [3, 5, 0]]), [edge]);
        assert_eq!(edges([[20, 5, 0], A[1], A[0]]), [edge]);
        assert_eq!(edges([A[1], A[0], A[2]]), [edge, [A[1], A[2]], [A[2], A[0]]]);
        // Raised by one unit, on the other side, of the same orientation, and without the edge.
        for b in [[3, 5, 1], [3, -5, 0]] {
            assert_eq!(edges([A[1], A[0], b]), [] as [[[i32; 3]; 2]; 0]);
        }
        assert!(edges(A).is_empty() && edges([A[0], [0, 4, 0], [4, 0, 0]]).is_empty());
        let internal = FaceTriangle { internal: [true, false, false], ..triangle(A) };
        assert_eq!(folded_edges(&internal, &triangle([A[1], A[0], [3, 5, 0]])).count(), 0);
    }

    /// Two adjacent boxes have four faces at an edge of their common wall.
    #[test]
    fn twins_are_those_of_the_same_body() {
        let edge = [[0, 0, 0], [0, 8, 0]];
        let wall = [edge[0], edge[1], [0, 4, -8]];
        let [top, front, coincident, its_top, below] = [
            [edge[1], edge[0], [8, 4, 0]],
            [edge[1], edge[0], [-8, 4, 3]],
            [edge[1], edge[0], [0, 3, -5]],
            [edge[1], edge[0], [-8, 4, 0]],
            [edge[1], edge[0], [8, 4, -8]],
        ];
        // (On the inner side of the wall, x is larger.)
        assert!(orientation(wall[0], wall[1], wall[2], [1, 0, 0]) < 0);
        let of = |others: &[Triangle]| twin(&wall, edge, others.iter()).copied();
        assert_eq!(of(&[coincident, front, top, its_top]), Some(top));
        assert_eq!(of(&[top, below, coincident]), Some(below));
        assert_eq!(of(&[its_top, front]), Some(front));
        assert_eq!(of(&[front, [edge[1], edge[0], [0, 4, 8]]]), Some([edge[1], edge[0], [0, 4, 8]]));
        assert_eq!(of(&[coincident]), None);
    }

    #[test]
    fn touching_is_fine() {
        let neighbour = [[8, 0, 0], [0, 0, 0], [0, -8, 3]];
        let in_one_plane = [[8, 0, 0], [0, 0, 0], [0, -8, 0]];
        let turned_round = [[0, 0, 0], [0, 8, 0], [8, 0, 0]];
        let at_a_corner = [[0, 0, 0], [-8, 0, 1], [0, -8, 1]];
        let edge_on_it = [[1, 1, 0], [3, 1, 0], [1, 1, 5]];
        let point_on_it = [[2, 2, 0], [3, 1, 5], [1, 1, 5]];
        let next_to_a_corner = [[0, 0, 0], [-8, -1, 2], [-1, -8, -2]];
        let separate = [[20, 0, 1], [28, 0, -1], [20, 8, 1]];
        let cases = [
            neighbour,
            in_one_plane,
            turned_round,
            at_a_corner,
            edge_on_it,
            point_on_it,
            next_to_a_corner,
            separate,
        ];
        for b in cases {
            assert_eq!(both(&A, &b), None, "{b:?}");
        }
    }

    #[test]
    fn passing_through_and_lying_on_is_not() {
        let through = [[1, 1, -3], [3, 1, -3], [2, 2, 5]];
        let across_an_edge = [[4, -2, -2], [4, 2, -2], [4, 0, 9]];
        let from_a_corner = [[0, 0, 0], [5, 4, 3], [4, 5, -3]];
        for b in [through, across_an_edge, from_a_corner] {
            assert_eq!(both(&A, &b), Some(DefectKind::Crossing), "{b:?}");
        }
        let shifted = [[1, 1, 0], [9, 1, 0], [1, 9, 0]];
        let folded = [[0, 0, 0], [8, 0, 0], [8, 8, 0]];
        let inside = [[1, 1, 0], [2, 1, 0], [1, 2, 0]];
        for b in [A, shifted, folded, inside] {
            assert_eq!(both(&A, &b), Some(DefectKind::Overlap), "{b:?}");
        }
    }

    /// An edge through an edge is a defect if it comes from the inside.
    #[test]
    fn edges_that_meet_edges() {
        // A ridge along y, with segments over it, into it, and through the middle of a flat one.
        let [one, other] = [[[0, -9, 0], [9, 0, -9], [0, 9, 0]], [[0, 9, 0], [-9, 0, -9], [0, -9, 0]]];
        let flat = [[0, 9, 0], [-9, 0, 9], [0, -9, 0]];
        let over = [[-5, 0, 0], [5, 0, 0]];
        let into = [[-1, 0, 5], [1, 0, -5]];
        assert!(!passes(over, &one, &other) && passes(into, &one, &other));
        assert!(passes(into, &one, &flat));
        let triangle = |corners: Triangle| FaceTriangle { corners, internal: [false; 3] };
        let b = triangle([into[0], into[1], [-9, 0, -20]]);
        let shared = Shared::of(&one, &b.corners);
        let found = contact(&triangle(one), &b, shared);
        assert!(matches!(found, Contact::Edges { .. }), "{found:?}");
        let internal = FaceTriangle { internal: [false, false, true], ..triangle(one) };
        assert_eq!(contact(&internal, &b, shared), Contact::Wrong(DefectKind::Crossing));
    }

    /// Large coordinates, and one unit that decides.
    #[test]
    fn one_unit_decides() {
        let far = (1 << 26) - 1;
        let a = [[0, 0, 0], [far, 0, far], [0, far, far]];
        // A point of its plane x + y = z, and those one unit above and below.
        let through = |low: i32| [[7, 9, 16 + low], [7, 10, 17 + low], [8, 10, 40]];
        assert_eq!(both(&a, &through(0)), None);
        assert_eq!(both(&a, &through(-1)), Some(DefectKind::Crossing));
        assert_eq!(both(&a, &through(1)), None);
    }
}

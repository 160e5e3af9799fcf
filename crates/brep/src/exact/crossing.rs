//! Crossings of axis-parallel paths with planar polygons: exact, in integers, with ties decided by
//! simulated perturbation (`perturbation.rs`).
//!
//! [`lattice`](super::lattice) is the equivalent for triangles and many lines at a time. Both use
//! the functions of this module that decide on which side of an edge or a plane a perturbed point
//! is.
//!
//! Invariant: all predicates perturb a point by the same vector, `Outline::side_of_moved` as well
//! as the test whether a line meets a polygon, for every face, cell and thread. So winding numbers
//! add up along any path, and those of neighbouring cells agree. If a single tie was decided
//! differently, everything beyond it would be inside out.

use super::bounds::{CROSSING_ROUNDING, HEIGHT_ROUNDING};
use super::perturbation::sign_or_first;
use super::vector::{ascending_others, dot, main_axis};

/// A planar polygon with holes on an integer grid, as input of crossing tests.
#[derive(Clone, Copy, Debug)]
pub struct Outline<'a> {
    /// Vertices of all rings, the outer ring's first.
    pub points: &'a [[i32; 3]],
    /// End of each ring in `points`.
    pub ring_ends: &'a [usize],
    /// Normal of the plane, on the side from which the outer ring is counterclockwise.
    pub normal: [i64; 3],
}

/// An off-grid point: coordinates in units of `2^-bits` of the grid's.
///
/// A coordinate has at most 27 integer bits and 32 fraction bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FinePoint {
    pub at: [i64; 3],
    pub bits: u32,
}

/// Returns the gradient of an edge's side function along the two other axes, seen along an axis.
/// The function is zero on the edge's line, and positive on the left of the direction from `a` to
/// `b`, with the first axis to the right and the second one up.
///
/// For coordinates of at most 31 bits.
#[inline]
pub(super) fn edge_gradient(a: [i32; 3], b: [i32; 3], [u, v]: [usize; 2]) -> [i64; 2] {
    [i64::from(a[v]) - i64::from(b[v]), i64::from(b[u]) - i64::from(a[u])]
}

/// Returns the side of a plane on which a perturbed point is, from the side of the point itself: 0
/// only if the normal is zero.
#[inline]
pub(super) fn moved_side(side: i32, normal: [i64; 3]) -> i32 {
    sign_or_first(i64::from(side), normal)
}

/// Returns the sign of the dot product of an edge's gradient and the vector to a point.
#[inline]
fn sign_across([a, c]: [i64; 2], [b, d]: [i64; 2]) -> i32 {
    // Most values are clearly not zero, which doubles decide.
    let (first, second) = (a as f64 * b as f64, c as f64 * d as f64);
    let sum = first + second;
    if sum.abs() > (first.abs() + second.abs()) * CROSSING_ROUNDING {
        return if sum > 0.0 { 1 } else { -1 };
    }
    let exact = i128::from(a) * i128::from(b) + i128::from(c) * i128::from(d);
    exact.signum() as i32
}

impl Outline<'_> {
    /// Returns the side of the plane on which a point is: 1 where the normal points to, 0 on the
    /// plane.
    #[inline]
    pub(crate) fn side(&self, point: &FinePoint) -> i32 {
        let from = self.points[0];
        let n = self.normal;
        let along = [0, 1, 2].map(|axis| point.at[axis] - (i64::from(from[axis]) << point.bits));
        let parts = [0, 1, 2].map(|axis| n[axis] as f64 * along[axis] as f64);
        let sum = parts[0] + parts[1] + parts[2];
        if sum.abs() > (parts[0].abs() + parts[1].abs() + parts[2].abs()) * HEIGHT_ROUNDING {
            return if sum > 0.0 { 1 } else { -1 };
        }
        dot(n.map(i128::from), along.map(i128::from)).signum() as i32
    }

    /// Returns the side of the plane on which the perturbed point is: never on the plane.
    #[inline]
    pub(crate) fn side_of_moved(&self, point: &FinePoint) -> i32 {
        moved_side(self.side(point), self.normal)
    }

    /// Returns whether the line along an axis through a perturbed point meets the polygon, by the
    /// even-odd rule.
    #[inline]
    fn is_met(&self, axis: usize, point: &FinePoint) -> bool {
        // (The smaller axis first, since its perturbation is larger.)
        let [u, v] = ascending_others(axis);
        let shift = point.bits;
        let (at_u, at_v) = (point.at[u], point.at[v]);
        let fine = |coordinate: i32| i64::from(coordinate) << shift;
        let mut inside = false;
        let mut start = 0;
        for &end in self.ring_ends {
            let ring = &self.points[start..end];
            start = end;
            let Some(mut a) = ring.last() else { continue };
            for b in ring {
                // The perturbed point is above a vertex of equal coordinate.
                let (above_a, above_b) = (fine(a[v]) > at_v, fine(b[v]) > at_v);
                if above_a != above_b {
                    let (low_u, high_u) = (a[u].min(b[u]), a[u].max(b[u]));
                    // Edges that pass at larger u count.
                    inside ^= if fine(low_u) > at_u {
                        true
                    } else if fine(high_u) < at_u {
                        false
                    } else {
                        let gradient = edge_gradient(*a, *b, [u, v]);
                        let turn = sign_across(gradient, [at_u - fine(a[u]), at_v - fine(a[v])]);
                        // Upwards, the point is on the left of an edge that passes at larger u. A
                        // point on the edge was perturbed past it, towards larger u.
                        (sign_or_first(i64::from(turn), gradient) > 0) == above_b
                    };
                }
                a = b;
            }
        }
        inside
    }

    /// Returns the change of the winding number along an axis, from a point to another coordinate:
    /// 1 if the path crosses the polygon from front to back, -1 from back to front, otherwise 0.
    #[inline]
    pub(crate) fn change_along(&self, axis: usize, from: &FinePoint, to: i64) -> i32 {
        if self.normal[axis] == 0 || !self.is_met(axis, from) {
            return 0;
        }
        let there = FinePoint {
            at: std::array::from_fn(|other| if other == axis { to } else { from.at[other] }),
            ..*from
        };
        let (start, end) = (self.side_of_moved(from), self.side_of_moved(&there));
        if start == end { 0 } else { start }
    }

    /// Returns whether a point is on the polygon, including its boundary.
    pub(crate) fn has(&self, point: &FinePoint) -> bool {
        if self.side(point) != 0 {
            return false;
        }
        let axis = main_axis(self.normal);
        self.is_met(axis, point) || self.is_on_boundary(axis, point)
    }

    /// Returns whether a point of the plane, perturbed within the plane, is on the polygon. Of
    /// adjacent polygons in a plane, exactly one contains it.
    pub(crate) fn has_moved(&self, point: &FinePoint) -> bool {
        self.is_met(main_axis(self.normal), point)
    }

    /// Returns whether a point of the plane is on an edge, seen along an axis.
    fn is_on_boundary(&self, axis: usize, point: &FinePoint) -> bool {
        let [u, v] = ascending_others(axis);
        let fine = |coordinate: i32| i64::from(coordinate) << point.bits;
        let mut start = 0;
        self.ring_ends.iter().any(|&end| {
            let ring = &self.points[start..end];
            start = end;
            (0..ring.len()).any(|i| {
                let (a, b) = (ring[i], ring[(i + 1) % ring.len()]);
                let within = [u, v].iter().all(|&axis| {
                    let (low, high) = (fine(a[axis].min(b[axis])), fine(a[axis].max(b[axis])));
                    (low..=high).contains(&point.at[axis])
                });
                let to = [u, v].map(|axis| point.at[axis] - fine(a[axis]));
                within && sign_across(edge_gradient(a, b, [u, v]), to) == 0
            })
        })
    }
}

/// Returns the change of the winding number by one polygon on the path between two points along x,
/// then y, then z.
#[inline]
pub(crate) fn change_between(outline: &Outline<'_>, from: &FinePoint, to: &FinePoint) -> i32 {
    let mut at = *from;
    let mut change = 0;
    for axis in 0..3 {
        if at.at[axis] != to.at[axis] {
            change += outline.change_along(axis, &at, to.at[axis]);
            at.at[axis] = to.at[axis];
        }
    }
    change
}

#[cfg(test)]
mod tests {
    use super::super::normal::ring_normal;
    use super::*;

    /// The faces of a box with walls between grid points, counterclockwise seen from outside.
    fn cuboid(min: [i32; 3], max: [i32; 3]) -> Vec<Vec<[i32; 3]>> {
        let at = |corner: usize| {
            std::array::from_fn(|axis| if corner >> axis & 1 == 1 { max[axis] } else { min[axis] })
        };
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
            .map(|face: [usize; 4]| face.map(at).to_vec())
            .to_vec()
    }

    fn winding(faces: &[Vec<[i32; 3]>], point: FinePoint) -> i32 {
        let outside = FinePoint { at: [-(9 << point.bits); 3], ..point };
        let change = |ring: &Vec<[i32; 3]>| {
            let outline = Outline { points: ring, ring_ends: &[ring.len()], normal: ring_normal(ring) };
            change_between(&outline, &outside, &point)
        };
        faces.iter().map(change).sum()
    }

    /// Every lattice point, also on walls, edges and corners, is inside a box if the point next to
    /// it towards larger coordinates is.
    #[test]
    fn boxes_have_what_is_inside() {
        let faces = cuboid([0; 3], [4, 3, 2]);
        for bits in [0, 1, 32] {
            for n in 0..7 * 7 * 7 {
                let at: [i64; 3] = [n % 7 - 1, n / 7 % 7 - 1, n / 49 - 1];
                let inside = (0..3).all(|axis| (0..[4, 3, 2][axis]).contains(&at[axis]));
                let point = FinePoint { at: at.map(|at| at << bits), bits };
                assert_eq!(winding(&faces, point), i32::from(inside), "{at:?}");
            }
        }
    }

    #[test]
    fn holes_are_no_part_and_boundaries_are() {
        let square = |low: i32, high: i32| [[low, low, 5], [high, low, 5], [high, high, 5], [low, high, 5]];
        let mut points = square(0, 9).to_vec();
        points.extend(square(3, 6).iter().rev());
        let outline = Outline { points: &points, ring_ends: &[4, 8], normal: ring_normal(&points[..4]) };
        let has = |at: [i64; 3]| outline.has(&FinePoint { at, bits: 1 });
        assert!(has([2, 2, 10]) && has([0, 7, 10]) && has([18, 18, 10]) && has([6, 7, 10]));
        assert!(!has([8, 8, 10]) && !has([2, 2, 11]) && !has([19, 18, 10]) && !has([20, 20, 10]));
        let passes = |at: [i64; 3]| outline.change_along(2, &FinePoint { at, bits: 1 }, 20);
        assert_eq!(passes([2, 2, 0]), -1);
        assert_eq!(passes([8, 8, 0]), 0);
        assert_eq!(passes([2, 2, 11]), 0);
    }
}

//! Crossings of segments along an axis with polygons: exact, by integer arithmetic.
//!
//! Whether a point is inside a solid is told by the faces between it and a point of which that is known. The
//! way from the one to the other may pass through edges and vertices, and either point may lie on a face; to
//! have an answer that is right for all faces together, every point is thought of as moved by an
//! infinitesimal vector, by far the most along x and by far the least along z (the simulation of simplicity
//! of Edelsbrunner and Muecke, 1990). A tie is then decided by the first derivative that is not zero, and
//! every segment meets a closed surface as one in general position does.
//!
//! Invariant: all that is asked here sees a point moved by the same vector: `Outline::side_of_moved` and the test
//! whether a line meets a polygon alike, for every face, cell and thread. So winding numbers add up along any way,
//! and those of neighbouring cells agree. Were one tie decided otherwise, all behind it would be inside out.

/// A planar polygon with holes on an integer grid, as crossings need it.
#[derive(Clone, Copy, Debug)]
pub struct Outline<'a> {
    /// Corners of all rings, the outer ring's first.
    pub points: &'a [[i32; 3]],
    /// End of each ring in `points`.
    pub ring_ends: &'a [usize],
    /// Normal of the plane, on the side from which the outer ring is counterclockwise.
    pub normal: [i64; 3],
}

/// A point between those of the grid: coordinates in units of `2^-bits` of the grid's.
///
/// A coordinate has at most 27 bits before the point and 32 behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FinePoint {
    pub at: [i64; 3],
    pub bits: u32,
}

/// The normal of a ring with coordinates of at most 26 bits, after Newell: its length is twice the area.
///
/// Of rings with many corners it may have more than 64 bits; it is divided by powers of two until it fits, which does
/// not happen to rings of a plane that have less than 2^8 turns.
pub fn ring_normal(ring: &[[i32; 3]]) -> [i64; 3] {
    let Some(&first) = ring.first() else { return [0; 3] };
    let from_first = |p: &[i32; 3]| [0, 1, 2].map(|axis| i64::from(p[axis]) - i64::from(first[axis]));
    if let [_, b, c] = ring {
        let (u, v) = (from_first(b), from_first(c));
        return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    }
    let mut normal = [0i128; 3];
    for corners in ring.windows(2) {
        let (a, b) = (from_first(&corners[0]), from_first(&corners[1]));
        for (axis, part) in normal.iter_mut().enumerate() {
            let [j, k] = [(axis + 1) % 3, (axis + 2) % 3];
            *part += i128::from(a[j] * b[k] - a[k] * b[j]);
        }
    }
    while normal.iter().any(|part| part.unsigned_abs() >> 62 != 0) {
        normal = normal.map(|part| part / 2);
    }
    normal.map(|part| part as i64)
}

/// The other two axes, in order.
const fn others(axis: usize) -> (usize, usize) {
    match axis {
        0 => (1, 2),
        1 => (0, 2),
        _ => (0, 1),
    }
}

/// The sign of `a * b - c * d`. The factors have at most 64 bits, the difference at most 126.
#[inline]
fn sign_of_difference(a: i64, b: i64, c: i64, d: i64) -> i32 {
    // Most are far from a tie, and doubles tell them.
    let (first, second) = (a as f64 * b as f64, c as f64 * d as f64);
    let difference = first - second;
    if difference.abs() > (first.abs() + second.abs()) * 1e-15 {
        return if difference > 0.0 { 1 } else { -1 };
    }
    let exact = i128::from(a) * i128::from(b) - i128::from(c) * i128::from(d);
    exact.signum() as i32
}

impl Outline<'_> {
    /// The side of the plane on which a point lies: 1 is where the normal points to, 0 is on the plane.
    #[inline]
    pub(crate) fn side(&self, point: &FinePoint) -> i32 {
        let from = self.points[0];
        let n = self.normal;
        let along = [0, 1, 2].map(|axis| point.at[axis] - (i64::from(from[axis]) << point.bits));
        let parts = [0, 1, 2].map(|axis| n[axis] as f64 * along[axis] as f64);
        let sum = parts[0] + parts[1] + parts[2];
        if sum.abs() > (parts[0].abs() + parts[1].abs() + parts[2].abs()) * 2e-15 {
            return if sum > 0.0 { 1 } else { -1 };
        }
        let exact: i128 = (0..3).map(|axis| i128::from(n[axis]) * i128::from(along[axis])).sum();
        exact.signum() as i32
    }

    /// The side of the plane on which a point lies that is moved a little: never on the plane.
    #[inline]
    pub(crate) fn side_of_moved(&self, point: &FinePoint) -> i32 {
        match self.side(point) {
            0 => self.normal.into_iter().find(|n| *n != 0).unwrap_or(1).signum() as i32,
            side => side,
        }
    }

    /// Whether the line along an axis through a point, moved a little, meets the polygon: by even and odd.
    #[inline]
    fn is_met(&self, axis: usize, point: &FinePoint) -> bool {
        // (The lesser axis first: by that one the point is moved more.)
        let (u, v) = others(axis);
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
                // The moved point lies above what it is on.
                let (above_a, above_b) = (fine(a[v]) > at_v, fine(b[v]) > at_v);
                if above_a != above_b {
                    let (low_u, high_u) = (a[u].min(b[u]), a[u].max(b[u]));
                    // Edges that pass on the side of greater u count.
                    inside ^= if fine(low_u) > at_u {
                        true
                    } else if fine(high_u) < at_u {
                        false
                    } else {
                        let (along_u, along_v) = (i64::from(b[u] - a[u]), i64::from(b[v] - a[v]));
                        let turn = sign_of_difference(along_u, at_v - fine(a[v]), along_v, at_u - fine(a[u]));
                        // Going up, the point is to the left of an edge that passes at a greater u. On the
                        // edge, the little step towards greater u has passed it.
                        turn != 0 && (turn > 0) == above_b
                    };
                }
                a = b;
            }
        }
        inside
    }

    /// The change of the winding number on the way from a point along an axis to another coordinate there: 1
    /// where the way passes the polygon from its front to its back, -1 the other way round, else 0.
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

    /// Whether a point lies on the polygon, its boundary included.
    pub(crate) fn has(&self, point: &FinePoint) -> bool {
        if self.side(point) != 0 {
            return false;
        }
        let axis = self.main_axis();
        self.is_met(axis, point) || self.is_on_boundary(axis, point)
    }

    /// Whether a point of the plane, moved a little within it, lies on the polygon: of polygons beside each other in a plane, one has
    /// it.
    pub(crate) fn has_moved(&self, point: &FinePoint) -> bool {
        self.is_met(self.main_axis(), point)
    }

    /// The axis along which the polygon is seen largest; the same for all of a plane.
    fn main_axis(&self) -> usize {
        (0..3).max_by_key(|axis| self.normal[*axis].unsigned_abs()).unwrap_or(2)
    }

    /// Whether a point of the plane lies on an edge, seen along an axis.
    fn is_on_boundary(&self, axis: usize, point: &FinePoint) -> bool {
        let (u, v) = others(axis);
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
                within
                    && sign_of_difference(
                        i64::from(b[u] - a[u]),
                        point.at[v] - fine(a[v]),
                        i64::from(b[v] - a[v]),
                        point.at[u] - fine(a[u]),
                    ) == 0
            })
        })
    }
}

/// The change of the winding number on the way from one point to another, along x, then y, then z, by one
/// polygon.
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

    /// Every point of a lattice, on walls, edges and corners too, is inside a box or outside as the point next
    /// to it towards greater coordinates.
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

//! Exact planes of faces, and lines along an axis through them.

use super::box3::Box3;
use super::turn::turn;
use crate::exact::normal::newell;
use crate::exact::vector::{dot, main_axis, others};

/// Returns whether a ring is convex, in the projection in which it is largest; it may have vertices
/// on straight sides. Rings that cross themselves may count as convex.
pub(crate) fn is_convex(ring: &[[i64; 3]]) -> bool {
    let Some(plane) = Plane::of_ring(ring) else { return false };
    let axis = plane.main_axis();
    let [mut u, mut v] = others(axis);
    if plane.normal[axis] < 0 {
        (u, v) = (v, u);
    }
    let count = ring.len();
    let at = |index: usize| [ring[index % count][u], ring[index % count][v]];
    (0..count).all(|index| turn(at(index), at(index + 1), at(index + 2)) >= 0)
}

/// A plane on the integer grid: the points whose dot product with the normal is the offset.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    /// Twice the area that the ring encloses in each projection along an axis, seen from that axis'
    /// positive end.
    pub(super) normal: [i128; 3],
    offset: i128,
}

impl Plane {
    /// Returns the plane of a ring through its first vertex (Newell's method), or `None` if the
    /// ring encloses no area.
    ///
    /// The plane of a ring that is not planar has the ring's mean direction.
    pub(super) fn of_ring(ring: &[[i64; 3]]) -> Option<Plane> {
        let &first = ring.first()?;
        let mut plane = Plane { normal: newell(ring), offset: 0 };
        plane.offset = plane.height(&first);
        (plane.normal != [0; 3]).then_some(plane)
    }

    /// Returns whether a point is in the plane.
    pub(super) fn contains(&self, point: &[i64; 3]) -> bool {
        self.height(point) == self.offset
    }

    /// Returns whether the plane intersects the octant's interior; touching a wall, an edge or a
    /// corner is not enough.
    pub(super) fn cuts(&self, octant: &Box3) -> bool {
        let (mut low, mut high) = (0, 0);
        for axis in 0..3 {
            let (near, far) = (
                self.normal[axis] * i128::from(octant.min[axis]),
                self.normal[axis] * i128::from(octant.max[axis]),
            );
            low += near.min(far);
            high += near.max(far);
        }
        low < self.offset && self.offset < high
    }

    /// Returns the axis along which the plane's projection is largest.
    pub(super) fn main_axis(&self) -> usize {
        main_axis(self.normal)
    }

    fn height(&self, point: &[i64; 3]) -> i128 {
        dot(self.normal, point.map(i128::from))
    }

    /// Returns an axis-parallel line that meets the plane inside the octant; the plane must cut the
    /// octant.
    ///
    /// A plane that cuts an octant crosses one of its edges between the ends, or contains two
    /// parallel edges, or contains the three corners next to a corner: fewer corners in the plane
    /// would not separate the corners on its two sides. In the first case, the line follows the
    /// crossed edge. In the other two, it passes a wall's centre, parallel to a side of that wall.
    /// So nine lines along each axis are sufficient.
    pub(super) fn line_into(&self, octant: &Box3) -> Option<Line> {
        let coordinates = |axis: usize| {
            let (low, high) = (octant.min[axis], octant.max[axis]);
            [(low + high, true), (2 * low, true), (2 * high, false)]
        };
        for axis in (0..3).filter(|&axis| self.normal[axis] != 0) {
            let [j, k] = others(axis);
            let ends =
                [octant.min[axis], octant.max[axis]].map(|end| 2 * i128::from(end) * self.normal[axis]);
            for at_j in coordinates(j) {
                for at_k in coordinates(k) {
                    let rest = self.normal[j] * i128::from(at_j.0) + self.normal[k] * i128::from(at_k.0);
                    let crossing = 2 * self.offset - rest;
                    if ends[0].min(ends[1]) < crossing && crossing < ends[0].max(ends[1]) {
                        return Some(Line { axis, at: [at_j, at_k] });
                    }
                }
            }
        }
        None
    }
}

/// A line along an axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    axis: usize,
    /// For each of the two other axes: twice the line's coordinate, and whether the line is
    /// infinitesimally above it or below. The offset along the second axis is infinitesimal
    /// relative to that along the first.
    at: [(i64, bool); 2],
}

impl Line {
    /// Returns whether the line passes through the region that a ring encloses, by the even-odd
    /// rule. Exact, if the line does not meet the ring itself.
    pub(super) fn passes_through(&self, ring: &[[i64; 3]]) -> bool {
        let [j, k] = others(self.axis);
        let [(at_j, above_j), (at_k, above_k)] = self.at;
        let is_above = |p: &[i64; 3]| if above_k { 2 * p[k] > at_k } else { 2 * p[k] >= at_k };
        let mut is_inside = false;
        for (i, b) in ring.iter().enumerate() {
            let a = &ring[(i + ring.len() - 1) % ring.len()];
            if is_above(a) == is_above(b) {
                continue;
            }
            let along = [b[j] - a[j], b[k] - a[k]].map(i128::from);
            let to_line = [at_j - 2 * a[j], at_k - 2 * a[k]].map(i128::from);
            let turn = along[0] * to_line[1] - along[1] * to_line[0];
            // Whether the edge passes the line on the side of larger coordinates. If it seems to
            // meet the line, the first axis decides, since the line's offset is larger there.
            is_inside ^= if turn == 0 { !above_j } else { (turn > 0) == is_above(b) };
        }
        is_inside
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every plane that cuts an octant has a line of [`Plane::line_into`], even if it crosses no
    /// edge of the octant.
    #[test]
    fn there_is_always_a_line_into_the_octant() {
        let octant = Box3 { min: [-1; 3], max: [1, 2, 1] };
        let mut cutting = 0;
        for n in 0..7 * 7 * 7 {
            let normal = [n % 7 - 3, n / 7 % 7 - 3, n / 49 - 3];
            for offset in -14..=14 {
                let plane = Plane { normal, offset };
                if plane.cuts(&octant) {
                    cutting += 1;
                    assert!(plane.line_into(&octant).is_some(), "{plane:?}");
                }
            }
        }
        assert!(cutting > 2_000, "{cutting}");
    }

    #[test]
    fn planes_that_touch_do_not_cut() {
        let octant = Box3 { min: [0; 3], max: [4; 3] };
        let plane = |normal, offset| Plane { normal, offset };
        assert!(!plane([0, 0, 1], 0).cuts(&octant), "a wall");
        assert!(!plane([0, 1, 1], 8).cuts(&octant), "an edge");
        assert!(!plane([1, 2, -1], 12).cuts(&octant), "a corner");
        assert!(!plane([1, 2, -1], 13).cuts(&octant), "outside");
        assert!(plane([1, 2, -1], 11).cuts(&octant));
        assert!(plane([1, -1, 0], 0).cuts(&octant), "through two edges");
    }

    #[test]
    fn the_normal_is_twice_the_area_on_the_side_that_sees_it_counterclockwise() {
        let ring = [[0, 0, 5], [3, 0, 5], [3, 2, 5], [0, 2, 5]];
        let plane = Plane::of_ring(&ring).unwrap();
        assert_eq!(plane.normal, [0, 0, 12]);
        assert!(plane.contains(&[9, -7, 5]) && !plane.contains(&[0, 0, 4]));
        assert!(Plane::of_ring(&[[0, 0, 0], [1, 1, 1], [2, 2, 2]]).is_none());
        assert!(Plane::of_ring(&[]).is_none());
    }
}

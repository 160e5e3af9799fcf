//! Triangulation of faces with holes over the same vertices, so that closed surfaces stay closed.

use std::collections::HashMap;

use super::ears::Ears;
use super::plane::Plane;
use super::sweep::Sweep;
use super::turn::turn;
use crate::exact::vector::others;
use spinney_base::sort;

/// Maximum number of vertices for ear clipping, which takes quadratic time or more.
const MAX_EARS: usize = 512;

/// Triangulates faces, and keeps its buffers between faces.
///
/// The time is bounded for any input. Faces of up to 512 vertices are triangulated by ear clipping,
/// in a bounded number of steps per vertex. Larger faces, and those that exceed the limit, are
/// triangulated by a sweep in `O(n log n)` steps for `n` vertices.
#[derive(Default)]
pub struct Triangulator {
    earcut: earcut::Earcut<f64>,
    /// First vertex at the same point, by vertex: touching rings then share a vertex.
    welded: Vec<u32>,
    first_at: HashMap<[i64; 3], u32>,
    /// Vertices, projected along the axis in which the face is largest; the outer ring is
    /// counterclockwise.
    flat: Vec<[i64; 2]>,
    floating: Vec<[f64; 2]>,
    hole_starts: Vec<u32>,
    proposal: Vec<u32>,
    /// Edges by their ends, the smaller one first; the lowest bit is set if the edge has that
    /// direction.
    edges: Vec<u128>,
    visits: u64,
}

impl Triangulator {
    /// Creates a triangulator with empty buffers.
    pub fn new() -> Triangulator {
        Triangulator::default()
    }

    /// Appends triangles that cover a face exactly to `out`, and returns whether that was possible;
    /// otherwise, `out` is unchanged.
    ///
    /// Triangles are indices into `points` and have the outer ring's orientation. Coordinates are
    /// at most 2^31 in magnitude. Each ring edge is an edge of exactly one triangle, in the ring's
    /// direction. All other edges belong to two triangles in opposite directions. So neighbouring
    /// faces still meet exactly, also where vertices are collinear or not quite coplanar. Vertices
    /// at one point are replaced by the first of them. A vertex on another edge is connected to it
    /// by a triangle without area. A hole with the outer ring's orientation is reversed. Faces that
    /// are not planar are triangulated in the projection in which they are largest. Three vertices
    /// are always a triangle; other faces need an area, and rings that do not cross.
    ///
    /// # Panics
    /// If `ring_ends` does not ascend to the number of points, or there are at least 2^32 points.
    pub fn triangulate(&mut self, points: &[[i64; 3]], ring_ends: &[usize], out: &mut Vec<[u32; 3]>) -> bool {
        assert_eq!(
            ring_ends.last().copied().unwrap_or(0),
            points.len(),
            "the last ring ends with the points"
        );
        assert!(u32::try_from(points.len()).is_ok(), "faces have fewer than 2^32 vertices");
        if points.len() == 3 && ring_ends.len() == 1 {
            out.push([0, 1, 2]);
            return true;
        }
        let outer = &points[..ring_ends.first().copied().unwrap_or(0)];
        let Some(plane) = Plane::of_ring(outer) else { return false };
        self.flatten(points, &plane);
        if points.len() == 4 && ring_ends.len() == 1 && self.is_convex_quadrilateral() {
            out.extend([[0, 1, 2], [0, 2, 3]]);
            return true;
        }
        self.weld(points);
        let rings = self.rings(ring_ends);
        let start = out.len();
        if points.len() <= MAX_EARS {
            // The crate uses floating point and drops collinear vertices. Its result is used only
            // if it is exactly right; our own, slower ear clipping keeps all vertices.
            self.propose(ring_ends, out);
            if self.covers(&rings, &out[start..]) {
                return true;
            }
            out.truncate(start);
            let mut ears = Ears::new(&self.flat);
            out.extend(ears.cut(rings.clone()));
            self.visits += ears.visits();
            if self.covers(&rings, &out[start..]) {
                return true;
            }
            out.truncate(start);
        }
        let mut sweep = Sweep::new(&self.flat);
        if let Ok(triangles) = sweep.cut(&rings) {
            out.extend(triangles);
        }
        self.visits += sweep.visits();
        // Invariant: this function only returns triangles that `covers` has verified (except single
        // triangles and convex quadrilaterals). So the algorithms above may use floating point,
        // abort, or fail on crossing rings. Without the check, a face could get gaps or overlapping
        // triangles.
        let covers = self.covers(&rings, &out[start..]);
        if !covers {
            out.truncate(start);
        }
        covers
    }

    /// Returns the number of vertex visits and orientation tests of the exact algorithms so far: a
    /// measure of their work.
    #[cfg_attr(not(test), expect(dead_code, reason = "tests limit the work"))]
    pub(crate) fn visits(&self) -> u64 {
        self.visits
    }

    fn flatten(&mut self, points: &[[i64; 3]], plane: &Plane) {
        let axis = plane.main_axis();
        let [mut j, mut k] = others(axis);
        if plane.normal[axis] < 0 {
            (j, k) = (k, j);
        }
        self.flat.clear();
        self.flat.extend(points.iter().map(|point| [point[j], point[k]]));
    }

    /// Four left turns, none of them by half a circle, are one full turn.
    fn is_convex_quadrilateral(&self) -> bool {
        let p = &self.flat;
        (0..4).all(|i| turn(p[i], p[(i + 1) % 4], p[(i + 2) % 4]) > 0)
    }

    // Invariant: vertices at one point have one number, that of the first. Edges are compared by
    // numbers: those of touching rings would not cancel otherwise, and a correct triangulation
    // would be rejected.
    fn weld(&mut self, points: &[[i64; 3]]) {
        self.first_at.clear();
        self.welded.clear();
        let corners = points.iter().zip(0..);
        self.welded.extend(corners.map(|(point, corner)| *self.first_at.entry(*point).or_insert(corner)));
    }

    /// Returns the rings by their welded vertices without repetitions; the outer ring is
    /// counterclockwise, holes are clockwise.
    fn rings(&self, ring_ends: &[usize]) -> Vec<Vec<u32>> {
        let mut rings = Vec::with_capacity(ring_ends.len());
        let mut start = 0;
        for &end in ring_ends {
            let mut ring = self.welded[start..end].to_vec();
            start = end;
            ring.dedup();
            while ring.len() > 1 && ring.first() == ring.last() {
                ring.pop();
            }
            if !rings.is_empty() && self.area(&ring) > 0 {
                ring.reverse();
            }
            // A hole that is a point or a line has no edges, or each in both directions.
            if rings.is_empty() || ring.len() > 2 {
                rings.push(ring);
            }
        }
        rings
    }

    /// Returns twice the area that a ring encloses counterclockwise.
    fn area(&self, ring: &[u32]) -> i128 {
        let at = |corner: u32| self.flat[corner as usize];
        ring.windows(2).map(|edge| turn(at(ring[0]), at(edge[0]), at(edge[1]))).sum()
    }

    fn propose(&mut self, ring_ends: &[usize], out: &mut Vec<[u32; 3]>) {
        self.floating.clear();
        self.floating.extend(self.flat.iter().map(|point| point.map(|x| x as f64)));
        self.hole_starts.clear();
        self.hole_starts.extend(ring_ends[..ring_ends.len() - 1].iter().map(|&end| end as u32));
        self.earcut.earcut_slice(&self.floating, &self.hole_starts, &mut self.proposal);
        let at = |corner: u32| self.flat[corner as usize];
        for corners in self.proposal.chunks_exact(3) {
            let [a, b, c] = [corners[0], corners[1], corners[2]].map(|corner| self.welded[corner as usize]);
            out.push(if turn(at(a), at(b), at(c)) < 0 { [a, c, b] } else { [a, b, c] });
        }
    }

    /// Returns whether triangles cover exactly the region that the rings enclose.
    ///
    /// No triangle is clockwise, and the triangles' edges, without those that occur in both
    /// directions, are the rings' edges. So the triangles' total winding number equals that of the
    /// rings at every point. Since no triangle contributes negatively, it is the number of
    /// triangles at the point: one inside, and none outside.
    fn covers(&mut self, rings: &[Vec<u32>], triangles: &[[u32; 3]]) -> bool {
        let at = |corner: u32| self.flat[corner as usize];
        self.edges.clear();
        let mut add = |a: u32, b: u32| {
            self.edges.push(u128::from(sort::pair_key([a.min(b), a.max(b)])) << 1 | u128::from(a < b));
        };
        for &[a, b, c] in triangles {
            if turn(at(a), at(b), at(c)) < 0 || a == b || b == c || c == a {
                return false;
            }
            add(a, b);
            add(b, c);
            add(c, a);
        }
        for ring in rings {
            (0..ring.len()).for_each(|i| add(ring[(i + 1) % ring.len()], ring[i]));
        }
        sort::numbers128(&mut self.edges);
        self.edges
            .chunk_by(|a, b| a >> 1 == b >> 1)
            .all(|same| 2 * same.iter().filter(|edge| **edge & 1 == 1).count() == same.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Ring = Vec<[i64; 2]>;

    fn triangulate(rings: &[Ring], triangulator: &mut Triangulator) -> Option<Vec<[u32; 3]>> {
        let mut ends = Vec::new();
        rings.iter().for_each(|ring| ends.push(ends.last().unwrap_or(&0) + ring.len()));
        let points: Vec<[i64; 3]> = rings.concat().into_iter().map(|[x, y]| [x, y, 5]).collect();
        let mut out = Vec::new();
        triangulator.triangulate(&points, &ends, &mut out).then_some(out)
    }

    fn doubled_area(ring: &[[i64; 2]]) -> i128 {
        (0..ring.len()).map(|i| turn([0, 0], ring[i], ring[(i + 1) % ring.len()])).sum()
    }

    /// Triangulates one ring, and checks the area and the work.
    #[track_caller]
    fn is_cut_quickly(mut ring: Ring) {
        if doubled_area(&ring) < 0 {
            ring.reverse();
        }
        let mut triangulator = Triangulator::new();
        let triangles = triangulate(std::slice::from_ref(&ring), &mut triangulator).unwrap();
        assert_eq!(triangles.len(), ring.len() - 2);
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|corner| ring[corner as usize]);
            let doubled = turn(a, b, c);
            assert!(doubled >= 0);
            doubled
        };
        assert_eq!(triangles.iter().map(area).sum::<i128>(), doubled_area(&ring));
        assert!(triangulator.visits() < 40 * ring.len() as u64, "{}", triangulator.visits());
    }

    const MANY: i64 = 100_000;

    #[test]
    fn combs_with_very_many_teeth() {
        let tooth = |i: i64| [[4 * i, 10], [4 * i + 1, 100_000], [4 * i + 2, 100_000], [4 * i + 3, 10]];
        let mut comb: Ring = (0..MANY / 4).flat_map(tooth).collect();
        comb.extend([[MANY, 0], [0, 0]]);
        // Rotated, one line crosses all teeth.
        is_cut_quickly(comb.iter().map(|&[x, y]| [y, -x]).collect());
        is_cut_quickly(comb);
        // Interleaved teeth from both sides.
        let mut zip: Ring = (0..MANY / 2).map(|i| [10 * i, if i % 2 == 0 { 0 } else { 1_000_000 }]).collect();
        zip.extend((0..MANY / 2).rev().map(|i| [10 * i, if i % 2 == 0 { 7 } else { 1_000_007 }]));
        is_cut_quickly(zip);
    }

    #[test]
    fn spirals_and_stars_with_very_many_corners() {
        let at = |angle: f64, radius: f64| [(radius * angle.cos()) as i64, (radius * angle.sin()) as i64];
        let arm = |i: i64, width: f64| at(i as f64 * 0.05, 1e4 * (i as f64 * 0.05 + 10.0 + width));
        let mut spiral: Ring = (0..MANY / 2).map(|i| arm(i, 0.0)).collect();
        spiral.extend((0..MANY / 2).rev().map(|i| arm(i, 3.0)));
        is_cut_quickly(spiral);
        // A coast: rays of varying length.
        let length = |i: i64| 1e6 + (i * 7_368_787 % 1_000_003) as f64 * 1e3;
        let angle = |i: i64| i as f64 / MANY as f64 * std::f64::consts::TAU;
        is_cut_quickly((0..MANY).map(|i| at(angle(i), length(i))).collect());
    }

    /// Crossing rings of all sizes: the counted work is small, and there are no triangles.
    #[test]
    fn what_crosses_is_found_out_soon() {
        for corners in [40, 300, 512, 513, 16_000, MANY] {
            let ring = |start: i64| -> Ring {
                let corner = |i: i64| [(i * i) % 10_007, (start + i * 7919) % 10_009];
                (start..start + corners).map(corner).collect()
            };
            for rings in [vec![ring(0)], vec![ring(0), ring(1), ring(2)]] {
                let mut triangulator = Triangulator::new();
                assert_eq!(triangulate(&rings, &mut triangulator), None);
                let count = rings.concat().len() as u64;
                let most = if count > MAX_EARS as u64 { 64 } else { 4096 + 512 + 64 };
                assert!(triangulator.visits() <= most * count, "{corners}: {}", triangulator.visits());
            }
        }
    }

    struct Random(u64);

    impl Random {
        fn below(&mut self, end: i64) -> i64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((self.0 >> 33) % end as u64) as i64
        }

        /// Subdivides a rectangle.
        fn divided(&mut self, [x, y, right, top]: [i64; 4], out: &mut Vec<[i64; 4]>) {
            let (wide, high) = (right - x, top - y);
            if wide.max(high) < 2 || self.below(8) == 0 {
                out.push([x, y, right, top]);
            } else if wide > high {
                let middle = x + 1 + self.below(wide - 1);
                self.divided([x, y, middle, top], out);
                self.divided([middle, y, right, top], out);
            } else {
                let middle = y + 1 + self.below(high - 1);
                self.divided([x, y, right, middle], out);
                self.divided([x, middle, right, top], out);
            }
        }
    }

    /// Rectangles as holes of a square that touch in vertices, along edges and within edges: the
    /// sweep triangulates the remainder in every slanted position.
    #[test]
    fn the_sweep_cuts_rings_that_touch() {
        let mut random = Random(3);
        let mut triangle_count = 0;
        for _ in 0..2000 {
            let side = 2 + random.below(14);
            let mut all = Vec::new();
            random.divided([0, 0, side, side], &mut all);
            let mut matrix = [0; 4];
            while matrix[0] * matrix[3] - matrix[1] * matrix[2] <= 0 {
                matrix = [0; 4].map(|_| random.below(7) - 3);
            }
            let place = |[x, y]: [i64; 2]| [matrix[0] * x + matrix[1] * y, matrix[2] * x + matrix[3] * y];
            let mut rings: Vec<Ring> = vec![vec![[0, 0], [side, 0], [side, side], [0, side]]];
            for [x, y, right, top] in all {
                if random.below(3) > 0 {
                    rings.push(vec![[x, y], [x, top], [right, top], [right, y]]);
                }
            }
            let rings: Vec<Ring> =
                rings.iter().map(|ring| ring.iter().map(|&corner| place(corner)).collect()).collect();
            let points = rings.concat();
            let mut triangulator = Triangulator { flat: points.clone(), ..Triangulator::default() };
            triangulator.weld(&points.iter().map(|&[x, y]| [x, y, 0]).collect::<Vec<_>>());
            let ends: Vec<usize> = (1..=rings.len()).map(|ring| 4 * ring).collect();
            let welded = triangulator.rings(&ends);
            let Ok(triangles) = Sweep::new(&points).cut(&welded) else { panic!("{rings:?}") };
            assert!(triangulator.covers(&welded, &triangles), "{rings:?}");
            let area = triangles.iter().map(|t| t.map(|corner| points[corner as usize]));
            let area: i128 = area.map(|[a, b, c]| turn(a, b, c)).sum();
            assert_eq!(area, rings.iter().map(|ring| doubled_area(ring)).sum::<i128>());
            triangle_count += triangles.len();
        }
        assert!(triangle_count > 20_000);
    }
}

//! Faces with holes into triangles over the same vertices, so that closed surfaces stay closed.

use std::collections::HashMap;

use super::ears::Ears;
use super::plane::Plane;
use super::sweep::Sweep;
use super::turn::turn;
use crate::exact::vector::others;
use spinney_base::sort;

/// Most corners of faces that are cut by clipping ears: their number's square and more is what that may take.
const MAX_EARS: usize = 512;

/// Cuts faces into triangles; keeps its buffers from face to face.
///
/// The time is bounded whatever the rings do. Faces of up to 512 corners are cut by clipping ears, in a bounded number of steps per
/// corner. Larger ones, and those that take more steps, are cut by a sweep, in a number of steps that grows as the
/// logarithm of the number of corners per corner.
#[derive(Default)]
pub struct Triangulator {
    earcut: earcut::Earcut<f64>,
    /// First corner at the same point, by corner: rings that touch, touch in one vertex.
    welded: Vec<u32>,
    first_at: HashMap<[i64; 3], u32>,
    /// The corners as seen along the axis from which the face is largest, the outer ring counterclockwise.
    flat: Vec<[i64; 2]>,
    floating: Vec<[f64; 2]>,
    hole_starts: Vec<u32>,
    proposal: Vec<u32>,
    /// Edges by their ends, the lesser one first, and in the lowest bit whether they go that way.
    edges: Vec<u128>,
    looks: u64,
}

impl Triangulator {
    /// A triangulator with empty buffers.
    pub fn new() -> Triangulator {
        Triangulator::default()
    }

    /// Appends triangles that cover a face exactly to `out`, and says whether that was possible; if not,
    /// `out` stays as it was.
    ///
    /// Triangles are indices into `points`, with coordinates of at most 2^31 in magnitude, and turn as the
    /// outer ring does. Every edge of every ring is an edge of exactly one triangle, in the ring's direction,
    /// and all other edges are those of two triangles in opposite directions; so neighbouring faces still
    /// meet exactly, also where corners lie on a straight line or not quite in one plane. Of corners at one
    /// point, the first stands for all. Where a corner lies on another edge, a triangle without area joins
    /// the two. A hole that turns as the outer ring does is turned round. Faces that are not planar are
    /// triangulated as they are seen along the axis from which they are largest. Three corners are a triangle
    /// whatever they enclose; other faces have to have an area, and rings that do not cross.
    ///
    /// # Panics
    /// If `ring_ends` does not rise up to the number of points, or there are more than 2^32.
    pub fn triangulate(&mut self, points: &[[i64; 3]], ring_ends: &[usize], out: &mut Vec<[u32; 3]>) -> bool {
        assert_eq!(
            ring_ends.last().copied().unwrap_or(0),
            points.len(),
            "the last ring ends with the points"
        );
        assert!(u32::try_from(points.len()).is_ok(), "faces have fewer than 2^32 corners");
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
            // The crate calculates in floating point and leaves out corners on straight lines. It proposes, and
            // what it proposes is taken if it is exactly right; the slower way of our own keeps all corners.
            self.propose(ring_ends, out);
            if self.covers(&rings, &out[start..]) {
                return true;
            }
            out.truncate(start);
            let mut ears = Ears::new(&self.flat);
            out.extend(ears.cut(rings.clone()));
            self.looks += ears.looks();
            if self.covers(&rings, &out[start..]) {
                return true;
            }
            out.truncate(start);
        }
        let mut sweep = Sweep::new(&self.flat);
        if let Ok(triangles) = sweep.cut(&rings) {
            out.extend(triangles);
        }
        self.looks += sweep.looks();
        // Invariant: no triangles leave this function that `covers` has not found to be right, whoever
        // proposed them (but for single triangles and convex quadrilaterals). Ways of cutting may therefore
        // calculate in floating point, give up, or go wrong where rings cross. Without that a face would have
        // holes where it has none, or lie twice over a place.
        let covers = self.covers(&rings, &out[start..]);
        if !covers {
            out.truncate(start);
        }
        covers
    }

    /// Corners that were looked at until now by exact ways of cutting, each as often as it was: a measure of their work.
    pub fn looks(&self) -> u64 {
        self.looks
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

    /// Four turns to the left, none of them by half a circle, make one round.
    fn is_convex_quadrilateral(&self) -> bool {
        let p = &self.flat;
        (0..4).all(|i| turn(p[i], p[(i + 1) % 4], p[(i + 2) % 4]) > 0)
    }

    // Invariant: corners at one point have one number, the first of theirs. Edges are compared by numbers:
    // those of rings that touch would not cancel otherwise, and a face that is right would seem to be left
    // open.
    fn weld(&mut self, points: &[[i64; 3]]) {
        self.first_at.clear();
        self.welded.clear();
        let corners = points.iter().zip(0..);
        self.welded.extend(corners.map(|(point, corner)| *self.first_at.entry(*point).or_insert(corner)));
    }

    /// The rings by their welded corners, none twice in a row, the outer one counterclockwise and holes
    /// clockwise.
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

    /// Twice the area that a ring encloses counterclockwise.
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

    /// Whether triangles cover exactly what the rings enclose.
    ///
    /// No triangle turns the wrong way, and the triangles' edges without those that go both ways are the
    /// rings' edges. So the triangles together go round every point as often as the rings do, and as none
    /// takes away, that is how many of them lie on the point: one inside, and none outside.
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
        assert!(triangulator.looks() < 40 * ring.len() as u64, "{}", triangulator.looks());
    }

    const MANY: i64 = 100_000;

    #[test]
    fn combs_with_very_many_teeth() {
        let tooth = |i: i64| [[4 * i, 10], [4 * i + 1, 100_000], [4 * i + 2, 100_000], [4 * i + 3, 10]];
        let mut comb: Ring = (0..MANY / 4).flat_map(tooth).collect();
        comb.extend([[MANY, 0], [0, 0]]);
        // All teeth are crossed by one line when the comb lies.
        is_cut_quickly(comb.iter().map(|&[x, y]| [y, -x]).collect());
        is_cut_quickly(comb);
        // Teeth from both sides, one between the others.
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
        // A coast: rays of all lengths.
        let length = |i: i64| 1e6 + (i * 7_368_787 % 1_000_003) as f64 * 1e3;
        let angle = |i: i64| i as f64 / MANY as f64 * std::f64::consts::TAU;
        is_cut_quickly((0..MANY).map(|i| at(angle(i), length(i))).collect());
    }

    /// Rings that cross, in all sizes: steps that are counted are few, and there are no triangles.
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
                assert!(triangulator.looks() <= most * count, "{corners}: {}", triangulator.looks());
            }
        }
    }

    struct Random(u64);

    impl Random {
        fn below(&mut self, end: i64) -> i64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((self.0 >> 33) % end as u64) as i64
        }

        /// Rectangles that divide one.
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

    /// Rectangles as holes of a square, which touch in corners, along edges and in the midst of edges: the sweep cuts what is
    /// left, in every slanted position.
    #[test]
    fn the_sweep_cuts_rings_that_touch() {
        let mut random = Random(3);
        let mut pieces = 0;
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
            pieces += triangles.len();
        }
        assert!(pieces > 20_000);
    }
}

//! Faces with holes into triangles over the same vertices, so that closed surfaces stay closed.

use std::collections::HashMap;

use super::ears::Ears;
use super::plane::{Plane, others};

/// Twice the signed area of the triangle of three points; positive counterclockwise.
pub(super) fn turn(a: [i64; 2], b: [i64; 2], c: [i64; 2]) -> i128 {
    let wide = |x: i64| i128::from(x);
    wide(b[0] - a[0]) * wide(c[1] - a[1]) - wide(b[1] - a[1]) * wide(c[0] - a[0])
}

/// Cuts faces into triangles; keeps its buffers from face to face.
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
    edges: Vec<([u32; 2], i8)>,
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
        // The crate calculates in floating point and leaves out corners on straight lines. It proposes, and
        // what it proposes is taken if it is exactly right; the slower way of our own keeps all corners.
        self.propose(ring_ends, out);
        if !self.covers(&rings, &out[start..]) {
            out.truncate(start);
            out.extend(Ears::new(&self.flat).cut(rings.clone()));
            if !self.covers(&rings, &out[start..]) {
                out.truncate(start);
                return false;
            }
        }
        true
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
        let mut add = |a: u32, b: u32, times: i8| {
            self.edges.push(if a < b { ([a, b], times) } else { ([b, a], -times) });
        };
        for &[a, b, c] in triangles {
            if turn(at(a), at(b), at(c)) < 0 || a == b || b == c || c == a {
                return false;
            }
            add(a, b, 1);
            add(b, c, 1);
            add(c, a, 1);
        }
        for ring in rings {
            (0..ring.len()).for_each(|i| add(ring[i], ring[(i + 1) % ring.len()], -1));
        }
        self.edges.sort_unstable();
        self.edges
            .chunk_by(|a, b| a.0 == b.0)
            .all(|same| same.iter().map(|&(_, times)| i64::from(times)).sum::<i64>() == 0)
    }
}

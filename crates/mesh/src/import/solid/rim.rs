//! Rims: edges of a surface's holes, where its winding field is not smooth.
//!
//! Except for the jumps by one at the surface itself, a winding field behaves like the magnetic
//! field of a current along the rims (Biot and Savart). Its gradient at a point is the integral,
//! over the rim, of the line element times the direction to it over the squared distance. Each
//! further derivative is divided by another distance.

use glam::DVec3;

use super::closure::edge_number;
use super::grid::{Triangle, place_key};
use spinney_base::sort;

/// Edges that are tested together.
const CHUNK: usize = 64;
/// Distance of a rim segment from a cube, in half widths of the cube, above which it counts as
/// equal for the whole cube.
const FAR: f64 = 3.0;
/// Maximum length of a closer segment, relative to its distance plus half of the cube's half width.
const LENGTH: f64 = 0.5;

/// Maximum number of segments that are listed for a cube. A cube with more is subdivided without
/// inspecting them.
const MANY: usize = 1 << 15;

/// All boundary edges of a surface.
#[derive(Debug)]
pub(super) struct Rims {
    edges: Vec<[[i32; 3]; 2]>,
    /// Bounding ball of each [`CHUNK`] of edges, and their total length.
    chunks: Vec<(EdgeSegment, f64)>,
}

/// Segment of an edge, or a bounding ball. `half` is the vector from the middle to one end.
#[derive(Clone, Copy, Debug)]
struct EdgeSegment {
    middle: DVec3,
    half: DVec3,
}

impl EdgeSegment {
    fn of(edge: &[[i32; 3]; 2]) -> EdgeSegment {
        let [from, to] = edge.map(|end| DVec3::from_array(end.map(f64::from)));
        EdgeSegment { middle: from.midpoint(to), half: (to - from) / 2.0 }
    }

    /// Lower bound of its distance from a cube.
    fn gap(&self, middle: DVec3, half: f64) -> f64 {
        ((self.middle - middle).abs() - half).max(DVec3::ZERO).length() - self.half.length()
    }
}

impl Rims {
    /// Maximum memory in bytes of the rims of this number of triangles.
    pub(super) fn memory(triangles: usize) -> u64 {
        (3 * triangles * size_of::<[[i32; 3]; 2]>()) as u64
    }

    /// Edges that the triangles have more often in one direction than in the other.
    pub(super) fn new(triangles: &[Triangle]) -> Rims {
        // Edge hash, then whether the edge runs forward, then which edge of which triangle it is.
        let mut numbers: Vec<u128> = Vec::with_capacity(3 * triangles.len());
        for (index, triangle) in (0u32..).zip(triangles) {
            for side in 0..3 {
                let [from, to] = edge(triangle, side);
                if from != to {
                    let (number, is_forward) = edge_number(from, to);
                    let below = u64::from(is_forward) << 32 | u64::from(3 * index + side);
                    numbers.push(u128::from(number) << 64 | u128::from(below));
                }
            }
        }
        sort::numbers128(&mut numbers);
        let mut edges = Vec::new();
        for same in numbers.chunk_by(|a, b| a >> 64 == b >> 64) {
            let forward = same.iter().filter(|number| **number >> 32 & 1 == 1).count();
            let first = same[0] as u32;
            let edge = edge(&triangles[first as usize / 3], first % 3);
            edges.extend((0..forward.abs_diff(same.len() - forward)).map(|_| edge));
        }
        drop(numbers);
        // (Edges with equal keys are in the order of their ends.)
        sort::point_pairs(&mut edges);
        sort::by_key(&mut edges, |[from, to]| {
            place_key(std::array::from_fn(|axis| from[axis].midpoint(to[axis])))
        });
        let ball = |edges: &[[[i32; 3]; 2]]| {
            let middle = EdgeSegment::of(&edges[0]).middle;
            let segments = || edges.iter().map(EdgeSegment::of);
            let radius = segments().map(|segment| segment.middle.distance(middle) + segment.half.length());
            let half = DVec3::new(radius.fold(0.0, f64::max), 0.0, 0.0);
            (EdgeSegment { middle, half }, segments().map(|segment| 2.0 * segment.half.length()).sum())
        };
        Rims { chunks: edges.chunks(CHUNK).map(ball).collect(), edges }
    }

    /// Rims around a cube with this centre and half width.
    pub(super) fn around(&self, middle: DVec3, half: f64) -> Rim {
        let mut rim = Rim::default();
        for (edges, (ball, length)) in self.edges.chunks(CHUNK).zip(&self.chunks) {
            let gap = ball.gap(middle, half);
            if gap > FAR * half {
                rim.far += length / gap.powi(5);
            } else {
                edges.iter().for_each(|edge| rim.add(EdgeSegment::of(edge), middle, half));
            }
            if rim.segments.len() > MANY {
                return Rim { has_too_many: true, ..Rim::default() };
            }
        }
        rim
    }
}

/// Edge of a triangle.
fn edge(triangle: &Triangle, side: u32) -> [[i32; 3]; 2] {
    let side = side as usize;
    [triangle.corners[side], triangle.corners[(side + 1) % 3]]
}

/// Rim segments in a cube and around it.
#[derive(Clone, Debug, Default)]
pub(super) struct Rim {
    /// Segments that may pass through the cube come first; with any of these there is no bound.
    /// `within` is their number.
    segments: Vec<EdgeSegment>,
    within: usize,
    /// Sum over more distant segments of length divided by the fifth power of distance.
    far: f64,
    /// Whether there are more than [`MANY`] segments, which are then not listed.
    has_too_many: bool,
}

impl Rim {
    /// Rims around a cube inside this one. `all` are all rims of the surface.
    pub(super) fn narrow(&self, all: &Rims, middle: DVec3, half: f64) -> Rim {
        if self.has_too_many {
            return all.around(middle, half);
        }
        let mut rim = Rim { far: self.far, ..Rim::default() };
        self.segments.iter().for_each(|segment| rim.add(*segment, middle, half));
        rim
    }

    /// Whether a rim may pass through the cube.
    pub(super) fn is_within(&self) -> bool {
        self.within > 0 || self.has_too_many
    }

    fn add(&mut self, segment: EdgeSegment, middle: DVec3, half: f64) {
        let gap = segment.gap(middle, half);
        let length = 2.0 * segment.half.length();
        if gap > FAR * half {
            self.far += length / gap.powi(5);
        } else if length > LENGTH * (gap.max(0.0) + half / 2.0) {
            let part = segment.half / 2.0;
            self.add(EdgeSegment { middle: segment.middle - part, half: part }, middle, half);
            self.add(EdgeSegment { middle: segment.middle + part, half: part }, middle, half);
        } else {
            self.segments.push(segment);
            if gap <= 0.0 {
                let last = self.segments.len() - 1;
                self.segments.swap(self.within, last);
                self.within += 1;
            }
        }
    }

    /// Bound of the smooth field's fourth derivatives along the axes, divided by 24, in a cube
    /// inside this one, with the half width as unit of length. Infinite if it exceeds `limit`, or
    /// if a rim may pass through the cube.
    pub(super) fn bend(&self, middle: DVec3, half: f64, limit: f64) -> f64 {
        if self.has_too_many {
            return f64::INFINITY;
        }
        let scale = half.powi(4) / (4.0 * std::f64::consts::PI);
        let mut sum = self.far * scale;
        for segment in &self.segments {
            sum += 2.0 * segment.half.length() / segment.gap(middle, half).max(0.0).powi(5) * scale;
            if sum > limit || sum.is_nan() {
                return f64::INFINITY;
            }
        }
        sum
    }
}

//! Bounds of the distance between two triangulated patches.
//!
//! The bound of a convex polygon's distance from a patch: the distance from a triangle, which is
//! convex, is a convex function, so its maximum is at one of the polygon's vertices. If this is not
//! small enough, the polygon is divided by the planes through the triangle's edges: over the
//! triangle, the distance is that from its plane, and the rest is compared with other triangles. So
//! a flat patch has the distance 0 from any other triangulation of it.

use super::tree::TriangleTree;

pub(super) type Point = [f64; 3];

/// Bounds are at most this multiple of the maximum distance that was found at a point.
const SLACK: f64 = 1.4;
/// Smallest bound in grid units: smaller distances are not distinguished.
const MIN_BOUND: f64 = 1.0 / 256.0;
/// Maximum number of divisions of a triangle.
const MAX_FRAGMENTS: usize = 2048;
/// Maximum number of vertices of a polygon.
const MAX_VERTICES: usize = 16;
/// Points that are this close to a plane, in grid units, are on it. Otherwise, rounding would cause
/// endless divisions.
const ON_PLANE: f64 = 1e-5;
/// Relative error of distances: far above the rounding of doubles, which have 53 bits.
const ROUNDING: f64 = 1e-9;
/// Maximum number of triangles that a polygon is passed on to before the nearest one is searched
/// for.
const MAX_STEPS: u8 = 4;

/// Returns a bound of the distance between two sets of triangles between the same points, both
/// ways. Distances of up to `tolerance` need not be distinguished.
pub(super) fn distance_bound(points: &[Point], a: &[[u32; 3]], b: &[[u32; 3]], tolerance: f64) -> f64 {
    if a.is_empty() || b.is_empty() {
        return if a.len() == b.len() { 0.0 } else { f64::INFINITY };
    }
    let corners = |triangle: &[u32; 3]| triangle.map(|point| points[point as usize]);
    let mut search =
        Search { found: 0.0, bound: 0.0, tolerance: tolerance.max(MIN_BOUND), fragments: Vec::new() };
    let trees = [TriangleTree::of(points, b), TriangleTree::of(points, a)];
    // Distances that are found first save divisions later.
    for (triangles, tree) in [a, b].into_iter().zip(&trees) {
        let mut near = 0;
        for triangle in triangles.iter().step_by(16) {
            let triangle = corners(triangle);
            for at in [triangle[0], centroid(&triangle)] {
                let (index, distance) = tree.nearest(at, near);
                near = index;
                search.found = search.found.max(distance);
            }
        }
    }
    for (triangles, tree) in [a, b].into_iter().zip(&trees) {
        let mut near = (0, 0);
        for triangle in triangles {
            // A triangle at the same vertex probably is the nearest one, or next to it.
            near = tree.at_any(triangle).map_or((near.0, 0), |at| (at, MAX_STEPS));
            near.0 = search.bound_triangle(&corners(triangle), tree, near);
        }
    }
    // (Coordinates have at most 26 bits, so their errors of rounding are below ON_PLANE.)
    search.bound * (1.0 + ROUNDING) + 4.0 * ON_PLANE
}

struct Search {
    /// Maximum distance of any point that was found.
    found: f64,
    /// Bound for all polygons so far.
    bound: f64,
    tolerance: f64,
    fragments: Vec<Fragment>,
}

/// A polygon whose distance is to be bounded.
struct Fragment {
    polygon: Polygon,
    /// A triangle that may be near.
    near: usize,
    /// Number of further triangles that may be tried instead of the nearest one.
    steps: u8,
}

impl Search {
    /// Adds the bound of a triangle, given the index of a triangle that may be near, and how often
    /// adjacent ones are tried before the nearest one is searched for. Returns the index of one
    /// that may be near the next triangle.
    fn bound_triangle(
        &mut self,
        triangle: &[Point; 3],
        tree: &TriangleTree,
        (near, steps): (usize, u8),
    ) -> usize {
        self.fragments.clear();
        self.fragments.push(Fragment { polygon: Polygon::of(triangle), near, steps });
        let (mut count, mut last) = (0, near);
        while let Some(Fragment { polygon, mut near, steps }) = self.fragments.pop() {
            count += 1;
            let mut distance = polygon.distance(tree, near);
            if !self.is_enough(distance) && steps == 0 {
                let (index, found) = tree.nearest(centroid(polygon.vertices()), near);
                self.found = self.found.max(found);
                if index != near {
                    near = index;
                    distance = polygon.distance(tree, near);
                }
            }
            last = near;
            if self.is_enough(distance) || count >= MAX_FRAGMENTS {
                self.bound = self.bound.max(distance);
                continue;
            }
            if polygon.len + 3 > MAX_VERTICES {
                let halves = polygon.fan_halves().map(|polygon| Fragment { polygon, near, steps });
                self.fragments.extend(halves);
                continue;
            }
            let Some(planes) = tree.edge_planes(near) else {
                self.halve(&polygon, near);
                continue;
            };
            let mut rest = Some(polygon);
            for (edge, plane) in planes.iter().enumerate() {
                let Some(whole) = rest else { break };
                let [inside, outside] = whole.divide(plane);
                rest = inside;
                let Some(outside) = outside else { continue };
                // The triangle across the edge is probably the nearest one.
                match tree.neighbour(near, edge) {
                    _ if steps == 0 && outside == polygon => self.halve(&outside, near),
                    Some(next) if steps != 1 => {
                        let steps = if steps == 0 { MAX_STEPS } else { steps - 1 };
                        self.fragments.push(Fragment { polygon: outside, near: next, steps });
                    }
                    _ => self.fragments.push(Fragment { polygon: outside, near, steps: 0 }),
                }
            }
            if let Some(rest) = rest {
                self.bound_above(&rest, tree, near, (count, steps));
            }
        }
        last
    }

    fn halve(&mut self, polygon: &Polygon, near: usize) {
        self.fragments.extend(polygon.halves().map(|polygon| Fragment { polygon, near, steps: 0 }));
    }

    /// Adds the bound of a polygon over a triangle: its distance from the triangle's plane. Where
    /// this is more than necessary, another triangle may be nearer.
    fn bound_above(
        &mut self,
        fragment: &Polygon,
        tree: &TriangleTree,
        near: usize,
        (count, steps): (usize, u8),
    ) {
        let (at, distance) = tree.highest(near, fragment.vertices());
        if !self.is_enough(distance) {
            if steps > 0 {
                self.fragments.push(Fragment { polygon: *fragment, near, steps: 0 });
                return;
            }
            self.found = self.found.max(tree.nearest(at, near).1);
            if !self.is_enough(distance) && count < MAX_FRAGMENTS {
                self.halve(fragment, near);
                return;
            }
        }
        self.bound = self.bound.max(distance);
    }

    /// Returns whether a bound is good enough.
    fn is_enough(&self, bound: f64) -> bool {
        bound <= (SLACK * self.found).max(self.tolerance).max(self.bound)
    }
}

/// A convex polygon.
#[derive(Clone, Copy, PartialEq)]
struct Polygon {
    points: [Point; MAX_VERTICES],
    len: usize,
}

impl Polygon {
    fn of(triangle: &[Point; 3]) -> Polygon {
        let mut points = [[0.0; 3]; MAX_VERTICES];
        points[..3].copy_from_slice(triangle);
        Polygon { points, len: 3 }
    }

    fn vertices(&self) -> &[Point] {
        &self.points[..self.len]
    }

    /// Returns the maximum distance of a point of the polygon from a triangle.
    fn distance(&self, tree: &TriangleTree, triangle: usize) -> f64 {
        let square = |point: &Point| tree.square_distance(triangle, *point);
        self.vertices().iter().map(square).fold(0.0, f64::max).sqrt()
    }

    fn push(&mut self, point: Point) {
        self.points[self.len] = point;
        self.len += 1;
    }

    /// Divides the polygon by a plane: the fragments where `normal . x` is at least `offset`, and
    /// below. The normal has length 1. Each fragment has at most one vertex more than the polygon.
    fn divide(&self, (normal, offset): &(Point, f64)) -> [Option<Polygon>; 2] {
        let side = |point: &Point| {
            let side = (0..3).map(|axis| normal[axis] * point[axis]).sum::<f64>() - offset;
            if side.abs() <= ON_PLANE { 0.0 } else { side }
        };
        let sides = self.vertices().iter().map(side);
        if sides.clone().all(|side| side >= 0.0) {
            return [Some(*self), None];
        }
        if sides.clone().all(|side| side <= 0.0) {
            return [None, Some(*self)];
        }
        let empty = Polygon { points: [[0.0; 3]; MAX_VERTICES], len: 0 };
        let mut both = [empty; 2];
        for index in 0..self.len {
            let (point, next) = (self.points[index], self.points[(index + 1) % self.len]);
            let (here, there) = (side(&point), side(&next));
            if here >= 0.0 {
                both[0].push(point);
            }
            if here <= 0.0 {
                both[1].push(point);
            }
            if here * there < 0.0 {
                let share = here / (here - there);
                let cut = [0, 1, 2].map(|axis| point[axis] + share * (next[axis] - point[axis]));
                both.iter_mut().for_each(|polygon| polygon.push(cut));
            }
        }
        both.map(|polygon| (polygon.len >= 3).then_some(polygon))
    }

    /// Divides the polygon along a diagonal, so that the halves have fewer vertices.
    fn fan_halves(&self) -> [Polygon; 2] {
        let empty = Polygon { points: [[0.0; 3]; MAX_VERTICES], len: 0 };
        let mut halves = [empty; 2];
        self.vertices()[..=self.len / 2].iter().for_each(|point| halves[0].push(*point));
        self.vertices()[self.len / 2..].iter().for_each(|point| halves[1].push(*point));
        halves[1].push(self.points[0]);
        halves
    }

    /// Divides the polygon across its longest edge.
    fn halves(&self) -> impl Iterator<Item = Polygon> + use<> {
        let length = |index: &usize| {
            let (a, b) = (self.points[*index], self.points[(index + 1) % self.len]);
            (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>()
        };
        let longest = (0..self.len).max_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or(0);
        let (a, b) = (self.points[longest], self.points[(longest + 1) % self.len]);
        let length = length(&longest).sqrt();
        let normal = [0, 1, 2].map(|axis| (b[axis] - a[axis]) / length);
        let offset = (0..3).map(|axis| normal[axis] * (a[axis] + b[axis]) / 2.0).sum();
        self.divide(&(normal, offset)).into_iter().flatten()
    }
}

fn centroid(points: &[Point]) -> Point {
    [0, 1, 2].map(|axis| points.iter().map(|point| point[axis]).sum::<f64>() / points.len() as f64)
}

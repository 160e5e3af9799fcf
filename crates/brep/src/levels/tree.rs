//! Nearest triangles: a tree of boxes over the triangles of a patch.

use super::distance::Point;
use spinney_base::sort;
use spinney_base::space::{Dimension, morton_encode};

/// Triangles per leaf.
const LEAF: usize = 4;

/// A binary tree over triangles that are sorted along a space-filling curve.
pub(super) struct TriangleTree {
    nodes: Vec<Node>,
    /// Sorted along the curve.
    triangles: Vec<[Point; 3]>,
    normals: Vec<Option<Point>>,
    /// The triangle across each edge, or [`NONE`].
    neighbours: Vec<[u32; 3]>,
    /// A triangle at each point, or [`NONE`].
    at_point: Vec<u32>,
}

/// Number of a triangle that does not exist.
const NONE: u32 = u32::MAX;

struct Node {
    min: Point,
    max: Point,
    /// The first triangle of a leaf, or the second child; the first child is the next node.
    at: u32,
    /// Number of triangles; 0 for other nodes.
    count: u32,
}

impl TriangleTree {
    /// Creates the tree over triangles between numbered points.
    pub(super) fn of(points: &[Point], triangles: &[[u32; 3]]) -> TriangleTree {
        let corners = |triangle: &[u32; 3]| triangle.map(|point| points[point as usize]);
        let sorted = sorted(triangles, &corners);
        let triangles: Vec<[Point; 3]> = sorted.iter().map(corners).collect();
        let normals = triangles.iter().map(unit_normal).collect();
        let mut nodes = Vec::with_capacity(triangles.len());
        build(&mut nodes, &triangles, 0);
        let mut at_point = vec![NONE; points.len()];
        for (number, triangle) in (0..).zip(&sorted) {
            triangle.iter().for_each(|point| at_point[*point as usize] = number);
        }
        TriangleTree { nodes, triangles, normals, neighbours: neighbours(&sorted), at_point }
    }

    /// Returns a triangle at one of the points, if there is any.
    pub(super) fn at_any(&self, points: &[u32; 3]) -> Option<usize> {
        let mut found = points.iter().map(|point| self.at_point[*point as usize]);
        found.find(|triangle| *triangle != NONE).map(|triangle| triangle as usize)
    }

    /// Returns the triangle across an edge of a triangle.
    pub(super) fn neighbour(&self, triangle: usize, edge: usize) -> Option<usize> {
        let found = self.neighbours[triangle][edge];
        (found != NONE).then_some(found as usize)
    }

    /// Returns the nearest triangle to a point, and its distance. The search is faster if the
    /// triangle `near` is near.
    pub(super) fn nearest(&self, to: Point, near: usize) -> (usize, f64) {
        let (mut best, mut square) = (near, self.square_distance(near, to));
        let mut open = [(0u32, 0.0); 64];
        let mut count = 1;
        open[0] = (0, self.box_distance(0, to));
        while count > 0 {
            count -= 1;
            let (index, distance) = open[count];
            if distance >= square {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count > 0 {
                for triangle in node.at..node.at + node.count {
                    let own = self.square_distance(triangle as usize, to);
                    if own < square {
                        (best, square) = (triangle as usize, own);
                    }
                }
                continue;
            }
            let children = [index + 1, node.at].map(|child| (child, self.box_distance(child as usize, to)));
            let [nearer, farther] =
                if children[0].1 <= children[1].1 { children } else { [children[1], children[0]] };
            // (The depth is at most that of 2^32 triangles, halved at each node.)
            open[count] = farther;
            open[count + 1] = nearer;
            count += 2;
        }
        (best, square.sqrt())
    }

    /// Returns the square of a point's distance from a node's box.
    fn box_distance(&self, node: usize, to: Point) -> f64 {
        let Node { min, max, .. } = &self.nodes[node];
        let off = |axis: usize| (min[axis] - to[axis]).max(to[axis] - max[axis]).max(0.0);
        (0..3).map(|axis| off(axis) * off(axis)).sum()
    }

    /// Returns the square of a point's distance from a triangle (after Ericson, "Real-time
    /// collision detection", 5.1.5).
    pub(super) fn square_distance(&self, triangle: usize, p: Point) -> f64 {
        let [a, b, c] = self.triangles[triangle];
        let (ab, ac, ap) = (minus(b, a), minus(c, a), minus(p, a));
        let (d1, d2) = (dot(ab, ap), dot(ac, ap));
        let square_from = |start: Point, along: Point, share: f64| {
            let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
            let off = minus(p, [0, 1, 2].map(|axis| start[axis] + share * along[axis]));
            dot(off, off)
        };
        if d1 <= 0.0 && d2 <= 0.0 {
            return dot(ap, ap);
        }
        let bp = minus(p, b);
        let (d3, d4) = (dot(ab, bp), dot(ac, bp));
        if d3 >= 0.0 && d4 <= d3 {
            return dot(bp, bp);
        }
        let vc = d1 * d4 - d3 * d2;
        if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
            return square_from(a, ab, d1 / (d1 - d3));
        }
        let cp = minus(p, c);
        let (d5, d6) = (dot(ab, cp), dot(ac, cp));
        if d6 >= 0.0 && d5 <= d6 {
            return dot(cp, cp);
        }
        let vb = d5 * d2 - d1 * d6;
        if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
            return square_from(a, ac, d2 / (d2 - d6));
        }
        let va = d3 * d6 - d5 * d4;
        if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
            return square_from(b, minus(c, b), (d4 - d3) / ((d4 - d3) + (d5 - d6)));
        }
        match self.normals.get(triangle).copied().flatten() {
            Some(normal) => dot(normal, ap).powi(2),
            // (Without an area: the nearest point of an edge.)
            None => [(a, b), (b, c), (c, a)]
                .into_iter()
                .map(|(from, to)| {
                    let along = minus(to, from);
                    square_from(from, along, dot(along, minus(p, from)) / dot(along, along))
                })
                .fold(f64::INFINITY, f64::min),
        }
    }

    /// Returns the planes through a triangle's edges at right angles to it, with their unit normals
    /// inwards: points over the triangle are on the positive side of all. `None` for a triangle
    /// without area.
    pub(super) fn edge_planes(&self, triangle: usize) -> Option<[(Point, f64); 3]> {
        let normal = self.normals[triangle]?;
        let [a, b, c] = self.triangles[triangle];
        let plane = |from: Point, to: Point| {
            let along = minus(to, from);
            let inwards = cross(normal, along).map(|part| part / dot(along, along).sqrt());
            (inwards, dot(inwards, from))
        };
        Some([plane(a, b), plane(b, c), plane(c, a)])
    }

    /// Returns the point that is farthest from a triangle's plane, and its distance from it.
    pub(super) fn highest(&self, triangle: usize, points: &[Point]) -> (Point, f64) {
        let (normal, a) = (self.normals[triangle].unwrap_or_default(), self.triangles[triangle][0]);
        points.iter().fold((a, 0.0), |highest, point| {
            let height = dot(normal, minus(*point, a)).abs();
            if height > highest.1 { (*point, height) } else { highest }
        })
    }
}

/// Bits per axis of positions on the curve, and of numbers of triangles next to them.
const CURVE_BITS: u32 = 13;
const NUMBER_BITS: u32 = 25;

/// Sorts triangles along the curve.
fn sorted(triangles: &[[u32; 3]], corners: &impl Fn(&[u32; 3]) -> [Point; 3]) -> Vec<[u32; 3]> {
    if triangles.len() >= 1 << NUMBER_BITS {
        return triangles.to_vec();
    }
    let centre = |triangle: &[u32; 3]| {
        let [a, b, c] = corners(triangle);
        [0, 1, 2].map(|axis| a[axis] + b[axis] + c[axis])
    };
    let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for at in triangles.iter().map(centre) {
        min = [0, 1, 2].map(|axis| min[axis].min(at[axis]));
        max = [0, 1, 2].map(|axis| max[axis].max(at[axis]));
    }
    let width = (0..3).map(|axis| max[axis] - min[axis]).fold(1.0, f64::max);
    let scale = f64::from((1 << CURVE_BITS) - 1) / width;
    let key = |(triangle, number): (&[u32; 3], u64)| {
        let at = centre(triangle);
        let part = |axis: usize| morton_encode(Dimension::Oct, ((at[axis] - min[axis]) * scale) as u32);
        (part(0) | part(1) << 1 | part(2) << 2) << NUMBER_BITS | number
    };
    let mut keys: Vec<u64> = triangles.iter().zip(0..).map(key).collect();
    sort::numbers64(&mut keys);
    let of = |key: &u64| triangles[(key & ((1 << NUMBER_BITS) - 1)) as usize];
    keys.iter().map(of).collect()
}

/// Adds the nodes over triangles, and returns their box.
fn build(nodes: &mut Vec<Node>, triangles: &[[Point; 3]], first: usize) -> [Point; 2] {
    let index = nodes.len();
    nodes.push(Node { min: [0.0; 3], max: [0.0; 3], at: first as u32, count: triangles.len() as u32 });
    let boxes = if triangles.len() <= LEAF {
        triangles
            .as_flattened()
            .iter()
            .fold([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]], |all, at| union(all, [*at, *at]))
    } else {
        let (low, high) = triangles.split_at(triangles.len() / 2);
        let below = build(nodes, low, first);
        nodes[index].at = nodes.len() as u32;
        nodes[index].count = 0;
        union(below, build(nodes, high, first + low.len()))
    };
    [nodes[index].min, nodes[index].max] = boxes;
    boxes
}

fn union(a: [Point; 2], b: [Point; 2]) -> [Point; 2] {
    [[0, 1, 2].map(|axis| a[0][axis].min(b[0][axis])), [0, 1, 2].map(|axis| a[1][axis].max(b[1][axis]))]
}

/// Returns the triangle across each edge: one with the opposite edge, if there is any. Very large
/// patches have none.
fn neighbours(triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut found = vec![[NONE; 3]; triangles.len()];
    let last = triangles.as_flattened().iter().max().copied().unwrap_or(0);
    if last >= 1 << 21 || triangles.len() >= 1 << 20 {
        return found;
    }
    let mut edges: Vec<u64> = Vec::with_capacity(3 * triangles.len());
    for (number, triangle) in (0..).zip(triangles) {
        for edge in 0..3 {
            let (from, to) = (triangle[edge], triangle[(edge + 1) % 3]);
            let (low, high) = (u64::from(from.min(to)), u64::from(from.max(to)));
            edges.push(low << 43 | high << 22 | number << 2 | edge as u64);
        }
    }
    sort::numbers64(&mut edges);
    for pair in edges.windows(2) {
        if pair[0] >> 22 == pair[1] >> 22 {
            let [(a, first), (b, second)] =
                [pair[0], pair[1]].map(|edge| ((edge & ((1 << 22) - 1)) as usize >> 2, (edge & 3) as usize));
            found[a][first] = b as u32;
            found[b][second] = a as u32;
        }
    }
    found
}

fn unit_normal([a, b, c]: &[Point; 3]) -> Option<Point> {
    let normal = cross(minus(*b, *a), minus(*c, *a));
    let length = dot(normal, normal).sqrt();
    (length > 0.0).then(|| normal.map(|part| part / length))
}

fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

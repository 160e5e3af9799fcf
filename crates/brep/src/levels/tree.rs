//! Nearest triangles: a tree of boxes over the triangles of a patch.

use super::distance::Point;

/// Triangles per leaf.
const LEAF: usize = 4;

/// A binary tree over triangles, in order of the boxes' medians along their longest sides.
pub(super) struct TriangleTree {
    nodes: Vec<Node>,
    /// Sorted for the leaves.
    triangles: Vec<[Point; 3]>,
    normals: Vec<Option<Point>>,
}

struct Node {
    min: Point,
    max: Point,
    /// The first triangle of a leaf, or the second child; the first child is the next node.
    at: u32,
    /// Number of triangles; 0 for other nodes.
    count: u32,
}

impl TriangleTree {
    pub(super) fn of(triangles: &[[Point; 3]]) -> TriangleTree {
        let mut tree = TriangleTree { nodes: Vec::new(), triangles: triangles.to_vec(), normals: Vec::new() };
        let mut triangles = std::mem::take(&mut tree.triangles);
        tree.divide(&mut triangles, 0);
        tree.normals = triangles.iter().map(unit_normal).collect();
        tree.triangles = triangles;
        tree
    }

    fn divide(&mut self, triangles: &mut [[Point; 3]], first: usize) {
        let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for point in triangles.as_flattened() {
            for axis in 0..3 {
                min[axis] = min[axis].min(point[axis]);
                max[axis] = max[axis].max(point[axis]);
            }
        }
        let index = self.nodes.len();
        self.nodes.push(Node { min, max, at: first as u32, count: triangles.len() as u32 });
        if triangles.len() <= LEAF {
            return;
        }
        let axis = (0..3).max_by(|a, b| (max[*a] - min[*a]).total_cmp(&(max[*b] - min[*b]))).unwrap_or(0);
        let key = |triangle: &[Point; 3]| triangle.iter().map(|point| point[axis]).sum::<f64>();
        let middle = triangles.len() / 2;
        triangles.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
        let (low, high) = triangles.split_at_mut(middle);
        self.divide(low, first);
        self.nodes[index].at = self.nodes.len() as u32;
        self.nodes[index].count = 0;
        self.divide(high, first + middle);
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

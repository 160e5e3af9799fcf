//! Triangulations with better angles: edges are flipped while that improves the angles (Lawson,
//! 1977). The triangulation is constrained: boundary edges stay.

use std::collections::HashMap;

use crate::exact::vector::others;
use spinney_base::sort;

/// An edge is flipped if the cotangents of its two opposite angles add up to less than this. Four
/// points on a circle have two equally good diagonals, and rounding would flip one for the other.
/// The rounding error is smaller than this bound for all but the thinnest triangles.
const FLIPPED_BELOW: f64 = -1e-9;

/// Flips inner edges of a triangulation of points of a plane. The triangles are counterclockwise as
/// seen from the tip of the normal: see [`flip`].
pub(crate) fn flip_in_plane(normal: [f64; 3], points: &[[f64; 3]], triangles: &mut [[u32; 3]]) {
    let axis = (0..3).max_by(|a, b| normal[*a].abs().total_cmp(&normal[*b].abs())).unwrap_or(2);
    let [u, v] = others(axis);
    let length = normal.iter().map(|part| part * part).sum::<f64>().sqrt();
    let normal = normal.map(|part| part / length);
    // Two directions in the plane that form a right-handed system with the normal.
    let across = normal[axis].hypot(normal[u]);
    let flat = |at: &[f64; 3]| {
        let first = (normal[axis] * at[u] - normal[u] * at[axis]) / across;
        let second = at[v] * across - normal[v] * (normal[u] * at[u] + normal[axis] * at[axis]) / across;
        [first, second]
    };
    flip(&points.iter().map(flat).collect::<Vec<_>>(), triangles);
}

/// Flips inner edges of a triangulation, with counterclockwise triangles over points of a plane,
/// until every edge is locally Delaunay. Stops after 64 flips for each triangle of the input in
/// total, which only rounding can cause. The result is deterministic.
fn flip(points: &[[f64; 2]], triangles: &mut [[u32; 3]]) {
    let mut sides: HashMap<[u32; 2], usize> = HashMap::new();
    for (number, &[a, b, c]) in triangles.iter().enumerate() {
        for edge in [[a, b], [b, c], [c, a]] {
            if sides.insert(edge, number).is_some() {
                // A directed edge occurs twice, since points coincide: not a valid triangulation.
                return;
            }
        }
    }
    let mut open: Vec<[u32; 2]> = sides.keys().copied().filter(|[a, b]| a < b).collect();
    sort::by_key(&mut open, |edge| sort::pair_key(*edge));
    let mut left = 64 * triangles.len();
    while let Some([a, b]) = open.pop() {
        let (Some(&one), Some(&other)) = (sides.get(&[a, b]), sides.get(&[b, a])) else { continue };
        let (c, d) = (third(triangles[one], a, b), third(triangles[other], a, b));
        let at = |corner: u32| points[corner as usize];
        let is_convex = area(at(a), at(d), at(c)) > 0.0 && area(at(d), at(b), at(c)) > 0.0;
        if !is_convex || sides.contains_key(&[c, d]) || sides.contains_key(&[d, c]) {
            continue;
        }
        // Flip if the angles opposite to the edge add up to more than 180 degrees.
        if cotangent(at(c), at(a), at(b)) + cotangent(at(d), at(b), at(a)) > FLIPPED_BELOW || left == 0 {
            continue;
        }
        left -= 1;
        (triangles[one], triangles[other]) = ([a, d, c], [d, b, c]);
        sides.remove(&[a, b]);
        sides.remove(&[b, a]);
        sides.extend([([a, d], one), ([d, c], one), ([c, a], one)]);
        sides.extend([([d, b], other), ([b, c], other), ([c, d], other)]);
        open.extend([[a, d], [d, b], [b, c], [c, a]]);
    }
}

/// Returns the triangle's vertex that is neither `a` nor `b`.
fn third(triangle: [u32; 3], a: u32, b: u32) -> u32 {
    triangle.into_iter().find(|corner| *corner != a && *corner != b).unwrap_or(a)
}

/// Returns twice the signed area of a triangle, positive if counterclockwise.
fn area(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Returns the cotangent of the angle at `corner` from `a` counterclockwise to `b`.
fn cotangent(corner: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let (a, b) = ([a[0] - corner[0], a[1] - corner[1]], [b[0] - corner[0], b[1] - corner[1]]);
    let sine = a[0] * b[1] - a[1] * b[0];
    // (Without an area, `corner` lies between `a` and `b`.)
    (a[0] * b[0] + a[1] * b[1]) / sine.max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fan_becomes_delaunay() {
        // A fan over a convex arc, and a vertex in the middle of an edge.
        let points: Vec<[f64; 2]> =
            (0..9).map(|i| f64::from(i) * 0.4).map(|t| [t.cos() * 10.0, t.sin() * 7.0]).collect();
        let mut triangles: Vec<[u32; 3]> = (2..9).map(|i| [0, i - 1, i]).collect();
        let sum = |triangles: &[[u32; 3]]| -> f64 {
            triangles
                .iter()
                .map(|t| area(points[t[0] as usize], points[t[1] as usize], points[t[2] as usize]))
                .sum()
        };
        let before = sum(&triangles);
        flip(&points, &mut triangles);
        assert!((sum(&triangles) - before).abs() < 1e-9);
        for t in &triangles {
            let [a, b, c] = t.map(|corner| points[corner as usize]);
            assert!(area(a, b, c) > 0.0);
            // No point is inside the circumcircle of a triangle.
            for p in &points {
                let to = |q: [f64; 2]| [q[0] - p[0], q[1] - p[1]];
                let rows = [a, b, c].map(to).map(|[x, y]| [x, y, x * x + y * y]);
                let determinant: f64 = (0..3)
                    .map(|i| {
                        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                        rows[i][2] * (rows[j][0] * rows[k][1] - rows[j][1] * rows[k][0])
                    })
                    .sum();
                assert!(determinant < 1e-6, "{determinant}");
            }
        }
        let mut flat = [[0, 1, 2], [0, 3, 1]];
        flip(&[[0.0, 0.0], [8.0, 0.0], [4.0, 0.0], [4.0, -4.0]], &mut flat);
        assert_eq!(flat, [[0, 3, 2], [3, 1, 2]]);
    }
}

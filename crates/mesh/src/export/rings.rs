//! Rectangles as rings of points, and triangulation of such rings.

use super::points::Points;

/// Rectangle of faces, in grid points of its block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rectangle {
    /// Axis of the normal.
    pub(super) normal: usize,
    /// Whether the solid is below the rectangle along that axis.
    pub(super) up: bool,
    /// Minimum corner; equal to `max` along the normal.
    pub(super) min: [u8; 3],
    /// Maximum corner.
    pub(super) max: [u8; 3],
    /// Attribute of the cells.
    pub(super) attribute: u32,
}

impl Rectangle {
    /// Corners, counterclockwise seen from outside.
    pub(super) fn corners(&self) -> [[u8; 3]; 4] {
        let (u, v) = ((self.normal + 1) % 3, (self.normal + 2) % 3);
        let (mut after_u, mut after_v) = (self.min, self.min);
        after_u[u] = self.max[u];
        after_v[v] = self.max[v];
        if self.up { [self.min, after_u, self.max, after_v] } else { [self.min, after_v, self.max, after_u] }
    }

    /// Coordinates of a point in the plane, such that the ring is counterclockwise.
    pub(super) fn flat(&self, point: [u8; 3]) -> [i32; 2] {
        let (u, v) = ((self.normal + 1) % 3, (self.normal + 2) % 3);
        let (u, v) = (i32::from(point[u]), i32::from(point[v]));
        if self.up { [u, v] } else { [v, u] }
    }
}

/// Ring around a rectangle, with all given points on its sides.
pub(super) fn ring(rectangle: &Rectangle, points: &Points, ring: &mut Vec<[u8; 3]>) {
    let corners = rectangle.corners();
    for (i, from) in corners.into_iter().enumerate() {
        let to = corners[(i + 1) % 4];
        ring.push(from);
        let Some(axis) = (0..3).find(|axis| from[*axis] != to[*axis]) else { continue };
        let mut point = from;
        loop {
            point[axis] = if to[axis] > from[axis] { point[axis] + 1 } else { point[axis] - 1 };
            if point == to {
                break;
            }
            if points.has(point) {
                ring.push(point);
            }
        }
    }
}

/// Triangulates a convex counterclockwise ring that may have points on its sides. No triangle is
/// degenerate.
///
/// Cuts ears off at corners, going around the ring. An ear is postponed if it would leave only
/// collinear points.
pub(super) fn triangulate(points: &[[i32; 2]]) -> Vec<[usize; 3]> {
    let double_area = |[a, b, c]: [usize; 3]| {
        let to = |i: usize| [points[i][0] - points[a][0], points[i][1] - points[a][1]];
        let (b, c) = (to(b), to(c));
        b[0] * c[1] - b[1] * c[0]
    };
    let mut ring: Vec<usize> = (0..points.len()).collect();
    let mut left: i32 = (1..points.len().saturating_sub(1)).map(|i| double_area([0, i, i + 1])).sum();
    let mut triangles = Vec::with_capacity(points.len().saturating_sub(2));
    let mut at = 0;
    let mut misses = 0;
    while ring.len() > 3 && misses < ring.len() {
        let count = ring.len();
        let ear = [ring[(at + count - 1) % count], ring[at % count], ring[(at + 1) % count]];
        let area = double_area(ear);
        // Points on a side make flat ears, of area 0. An ear as large as the remaining area would
        // leave a ring of collinear points, which no triangle can fill.
        if area > 0 && area < left {
            triangles.push(ear);
            ring.remove(at % count);
            left -= area;
            misses = 0;
            // Skip a corner: adjacent ears make slivers.
            at = (at + 1) % (count - 1);
        } else {
            misses += 1;
            at = (at + 1) % count;
        }
    }
    if let [a, b, c] = ring[..] {
        triangles.push([a, b, c]);
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_fill_rings_and_none_is_flat() {
        for marks in 0..1u32 << 12 {
            let mut points = Vec::new();
            let mut mark = 0;
            for (from, step) in [([0, 0], [1, 0]), ([4, 0], [0, 1]), ([4, 4], [-1, 0]), ([0, 4], [0, -1])] {
                points.push(from);
                for i in 1..4 {
                    if marks >> mark & 1 > 0 {
                        points.push([from[0] + i * step[0], from[1] + i * step[1]]);
                    }
                    mark += 1;
                }
            }
            let triangles = triangulate(&points);
            assert_eq!(triangles.len(), points.len() - 2, "{points:?}");
            let area = |[a, b, c]: [usize; 3]| {
                let [a, b, c] = [points[a], points[b], points[c]];
                (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
            };
            assert!(triangles.iter().all(|triangle| area(*triangle) > 0));
            assert_eq!(triangles.iter().map(|triangle| area(*triangle)).sum::<i32>(), 32);
        }
    }
}

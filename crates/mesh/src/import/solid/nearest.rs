//! Nearest face of an open surface that has a point on its inner side.

use glam::DVec3;

use super::field::{LEAF, WindingField, wide};
use spinney_brep::exact::bounds::SOLID_BITS;

/// Factor that keeps distances lower bounds of triangle distances despite rounding: about ten times
/// the rounding error of each.
const ROUNDED_DOWN: f64 = 1.0 - 1e-9;
const _: () = assert!(1.0 - ROUNDED_DOWN > 40.0 * f64::EPSILON);
/// Absolute margin in grid units, in addition. It covers cancellation, where a small distance has
/// a few rounding errors of the largest grid coordinates.
const STEPS_LESS: f64 = 1e-3;
const _: () = assert!(STEPS_LESS > 8.0 * f64::EPSILON * (2u64 << SOLID_BITS) as f64);

impl WindingField {
    /// Attribute at a point inside, in grid units: that of the nearest triangle with the point on
    /// its inner side, or the minimum if several are equally near. `is_inverted` swaps the sides,
    /// for inverted surfaces. (Of two touching bodies, one is on the inner side of the common wall
    /// and the other on its outer side.)
    pub(super) fn attribute(&self, point: DVec3, is_inverted: bool) -> u32 {
        if let [attribute] = self.attributes[..] {
            return attribute;
        }
        // In an inverted surface, the point is on the outer side.
        let side = if is_inverted { -1.0 } else { 1.0 };
        let (mut best, mut any) = ((f64::INFINITY, 0), (f64::INFINITY, 0));
        let mut open = if self.groups.is_empty() { Vec::new() } else { vec![0] };
        while let Some(index) = open.pop() {
            let group = &self.groups[index as usize];
            if self.least_distance(index, point).powi(2) > best.0 {
                continue;
            }
            if group.count <= LEAF {
                for number in group.first as usize..(group.first + group.count) as usize {
                    let triangle @ [a, b, c] = self.triangles[number].map(wide);
                    let found = (distance_squared(&triangle, point), self.attributes[number]);
                    let is_inner = (b - a).cross(c - a).dot(point - a) * side <= 0.0;
                    any = nearer(any, found);
                    if is_inner {
                        best = nearer(best, found);
                    }
                }
                continue;
            }
            // The nearer child first, so that it rules out the other.
            let (a, b) = (index + 1, self.groups[index as usize + 1].next);
            let is_nearer = self.least_distance(a, point) <= self.least_distance(b, point);
            open.extend(if is_nearer { [b, a] } else { [a, b] });
        }
        // (A surface of loose faces may have none.)
        if best.0.is_finite() { best.1 } else { any.1 }
    }

    /// Lower bound of the distance to a group's triangles, reduced for rounding.
    fn least_distance(&self, index: u32, point: DVec3) -> f64 {
        let group = &self.groups[index as usize];
        ((group.centre.distance(point) - f64::from(group.radius)) * ROUNDED_DOWN - STEPS_LESS).max(0.0)
    }
}

/// The nearer of two triangles, given as squared distance and attribute. Ties resolve to the
/// smaller attribute.
fn nearer(one: (f64, u32), other: (f64, u32)) -> (f64, u32) {
    let is_other = other.0 < one.0 || (other.0 == one.0 && other.1 < one.1);
    if is_other { other } else { one }
}

/// Squared distance of a point from a triangle: from its plane if the point projects into the
/// triangle, otherwise from the nearest edge.
fn distance_squared([a, b, c]: &[DVec3; 3], point: DVec3) -> f64 {
    let normal = (*b - *a).cross(*c - *a);
    let edges = [(a, b), (b, c), (c, a)];
    if edges.iter().all(|(from, to)| normal.cross(**to - **from).dot(point - **from) >= 0.0) {
        return (point - *a).dot(normal).powi(2) / normal.length_squared();
    }
    let to_edge = |(from, to): &(&DVec3, &DVec3)| {
        let along = **to - **from;
        let share = ((point - **from).dot(along) / along.length_squared()).clamp(0.0, 1.0);
        point.distance_squared(**from + along * share)
    };
    edges.iter().map(to_edge).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::super::grid::Triangle;
    use super::*;

    #[test]
    fn points_inside_have_the_attribute_of_the_nearest_face() {
        // Boxes in a row that share walls, each with its own attribute.
        let cube = |i: i32| {
            let p = |corner: i32| [100 * (i + (corner & 1)), 100 * (corner >> 1 & 1), 100 * (corner >> 2)];
            let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
            let triangles = quads.map(|[a, b, c, d]| [[p(a), p(b), p(c)], [p(a), p(c), p(d)]]);
            triangles.concat().into_iter().map(move |corners| Triangle {
                corners,
                attribute: i as u32,
                part: 1,
            })
        };
        let mut triangles: Vec<Triangle> = (0..20).flat_map(cube).collect();
        for is_inverted in [false, true] {
            let field = WindingField::new(&triangles, &()).unwrap();
            for i in 0..20u32 {
                for x in [1.0, 10.0, 50.0, 98.0] {
                    let point = DVec3::new(f64::from(100 * i) + x, 40.0, 55.0);
                    assert_eq!(field.attribute(point, is_inverted), i, "{x} {is_inverted}");
                }
            }
            triangles.iter_mut().for_each(|triangle| triangle.corners.swap(0, 1));
        }
        assert_eq!(WindingField::new(&triangles[36..48], &()).unwrap().attribute(DVec3::ZERO, false), 3);
        let [a, b, c] = [DVec3::ZERO, DVec3::X * 4.0, DVec3::Y * 4.0];
        for (point, expected) in [([1.0, 1.0, 3.0], 9.0), ([4.0, 4.0, 1.0], 9.0), ([-3.0, -4.0, 0.0], 25.0)] {
            assert!((distance_squared(&[a, b, c], DVec3::from_array(point)) - expected).abs() < 1e-9);
        }
    }
}

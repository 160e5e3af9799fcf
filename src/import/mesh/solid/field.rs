//! The winding field of a surface that need not be closed: how much of the view from a point is covered by the surface's
//! inner side, 1 inside a closed one and 0 outside it, and something between near holes.
//!
//! Jacobson, Kavan, Sorkine-Hornung, "Robust inside-outside segmentation using generalized winding numbers" (2013); the far
//! field of a group of triangles is that of a dipole: Barill and others, "Fast winding numbers for soups and clouds"
//! (2018).

use glam::DVec3;

use super::grid::Triangle;
use crate::{Error, Result};

/// Triangles that are looked at one by one.
const LEAF: usize = 8;
/// A group is far away at so many times its radius. Dipoles are then right to about a hundredth.
const FAR: f64 = 2.5;
/// Where the field is further than this from one half, what is inside is sure.
const DOUBT: f64 = 0.2;

/// A surface's winding field, by a hierarchy of its triangles. A question takes time that grows with the logarithm of their
/// number.
#[derive(Debug)]
pub(super) struct Field {
    triangles: Vec<[DVec3; 3]>,
    /// In preorder; a group's first part follows it.
    groups: Vec<Group>,
}

#[derive(Debug)]
struct Group {
    /// Sum of the normals, as long as the triangles' areas.
    normal: DVec3,
    /// Centre, weighted by area.
    centre: DVec3,
    radius: f64,
    /// The triangles.
    first: u32,
    count: u32,
    /// The group that follows after all parts of this one.
    next: u32,
}

impl Field {
    /// Bytes of memory that a field of so many triangles takes.
    pub(super) fn memory(triangles: usize) -> u64 {
        let groups = 4 * triangles.div_ceil(LEAF);
        (triangles * (size_of::<[DVec3; 3]>() + 16) + groups * size_of::<Group>()) as u64
    }

    /// The field of these triangles.
    ///
    /// # Errors
    /// If there are more than 2^31.
    pub(super) fn new(triangles: impl Iterator<Item = Triangle>) -> Result<Field> {
        let mut sorted: Vec<(u64, [DVec3; 3])> = triangles
            .map(|triangle| {
                let middle = |axis: usize| {
                    triangle.corners.iter().map(|corner| i64::from(corner[axis])).sum::<i64>() / 3
                };
                // Coordinates run from -2^29 to 2^30.
                let place = |axis: usize| ((middle(axis) + (1 << 29)) as u64) >> 10;
                let key = spread(place(0)) | spread(place(1)) << 1 | spread(place(2)) << 2;
                (key, triangle.corners.map(|corner| DVec3::from_array(corner.map(f64::from))))
            })
            .collect();
        if sorted.len() > i32::MAX as usize {
            let found = format!("{} triangles", sorted.len());
            return Err(Error::invalid("the surface is not closed and has", found, "at most 2^31"));
        }
        sorted.sort_by_key(|(key, _)| *key);
        let triangles: Vec<_> = sorted.into_iter().map(|(_, triangle)| triangle).collect();
        let mut field = Field { triangles, groups: Vec::new() };
        field.group(0, field.triangles.len());
        Ok(field)
    }

    fn group(&mut self, first: usize, end: usize) {
        let place = self.groups.len();
        let triangles = &self.triangles[first..end];
        let (mut normal, mut centre, mut area) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for [a, b, c] in triangles {
            let n = (*b - *a).cross(*c - *a) / 2.0;
            let size = n.length();
            normal += n;
            area += size;
            centre += (*a + *b + *c) / 3.0 * size;
        }
        centre /= area.max(f64::MIN_POSITIVE);
        let corners = triangles.iter().flatten();
        let radius = corners.map(|corner| corner.distance_squared(centre)).fold(0.0, f64::max).sqrt();
        let (count, next) = ((end - first) as u32, 0);
        self.groups.push(Group { normal, centre, radius, first: first as u32, count, next });
        if end - first > LEAF {
            let middle = first.midpoint(end);
            self.group(first, middle);
            self.group(middle, end);
        }
        self.groups[place].next = self.groups.len() as u32;
    }

    /// The field at a point, in grid steps.
    pub(super) fn at(&self, point: DVec3) -> f64 {
        let mut sum = 0.0;
        let mut place = 0;
        while let Some(group) = self.groups.get(place) {
            let away = group.centre - point;
            let distance = away.length();
            if distance > FAR * group.radius {
                sum += group.normal.dot(away) / (distance * distance * distance);
                place = group.next as usize;
            } else if group.count as usize <= LEAF {
                let triangles = &self.triangles[group.first as usize..][..group.count as usize];
                sum += triangles.iter().map(|triangle| solid_angle(triangle, point)).sum::<f64>();
                place = group.next as usize;
            } else {
                place += 1;
            }
        }
        sum / (4.0 * std::f64::consts::PI)
    }

    /// Whether a cube that no triangle reaches into lies inside; `None` where that is in doubt somewhere.
    pub(super) fn uniform(&self, min: [i32; 3], width: i32) -> Option<bool> {
        let (min, width) = (DVec3::from_array(min.map(f64::from)), f64::from(width));
        let mut answer = None;
        let corners = (0..8).map(|i| DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64));
        for place in [DVec3::splat(0.5)].into_iter().chain(corners) {
            // A little inside the cube: its corners may lie on triangles.
            let field = self.at(min + (place * 0.98 + 0.01) * width) - 0.5;
            if field.abs() < DOUBT || answer.is_some_and(|answer| answer != (field > 0.0)) {
                return None;
            }
            answer = Some(field > 0.0);
        }
        answer
    }
}

/// The solid angle under which a triangle is seen, positive from its inner side (Van Oosterom and Strackee, 1983).
fn solid_angle([a, b, c]: &[DVec3; 3], from: DVec3) -> f64 {
    let (a, b, c) = (*a - from, *b - from, *c - from);
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let over = a.dot(b.cross(c));
    let under = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * over.atan2(under)
}

/// Moves bit `i` of 21 to bit `3 i`.
fn spread(mut x: u64) -> u64 {
    x &= 0x1f_ffff;
    x = (x | x << 32) & 0x001f_0000_0000_ffff;
    x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_field_is_one_inside_and_zero_outside_and_half_in_a_hole() {
        // A ball of many triangles, so that groups are used.
        let rings = 24;
        let point = |i: i32, j: i32| {
            let (a, b) = (
                f64::from(i) * std::f64::consts::PI / f64::from(rings),
                f64::from(j) * std::f64::consts::PI / f64::from(rings),
            );
            [a.sin() * b.cos(), a.sin() * b.sin(), a.cos()].map(|x| (x * 10000.0).round() as i32)
        };
        let mut triangles = Vec::new();
        for i in 0..rings {
            for j in 0..2 * rings {
                let (a, b, c, d) = (point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1));
                triangles.push(Triangle { corners: [a, b, c], attribute: 0 });
                triangles.push(Triangle { corners: [a, c, d], attribute: 0 });
            }
        }
        let field = Field::new(triangles.iter().copied()).unwrap();
        for (point, expected) in
            [([0.0, 0.0, 0.0], 1.0), ([9000.0, 0.0, 0.0], 1.0), ([0.0, 11000.0, 0.0], 0.0)]
        {
            let found = field.at(DVec3::from_array(point));
            assert!((found - expected).abs() < 0.02, "{point:?}: {found}");
        }
        assert_eq!(field.uniform([-2000; 3], 4000), Some(true));
        assert_eq!(field.uniform([9000; 3], 4000), Some(false));
        // The upper half alone is a bowl; in its opening the field is a half.
        let half = triangles.into_iter().filter(|triangle| triangle.min(2) >= -10);
        let field = Field::new(half).unwrap();
        assert!((field.at(DVec3::new(0.0, 0.0, 0.0)) - 0.5).abs() < 0.02);
        assert_eq!(field.uniform([-100; 3], 200), None);
    }
}

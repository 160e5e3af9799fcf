//! The winding field of a surface that need not be closed: how much of the view from a point is covered by
//! the surface's inner side, 1 inside a closed one and 0 outside it, and something between near holes.
//!
//! Jacobson, Kavan, Sorkine-Hornung, "Robust inside-outside segmentation using generalized winding numbers"
//! (2013); the far field of a group of triangles is that of a dipole: Barill and others, "Fast winding
//! numbers for soups and clouds" (2018).

use glam::DVec3;

use super::closure::edge_number;
use super::grid::Triangle;
use crate::space::{Dimension, morton_encode};
use crate::{Error, Progress, Result};

/// Triangles that are looked at one by one.
const LEAF: usize = 4;
/// Distance of a group from a point, in radii of the group, from which on its field is that of a dipole. The
/// error is then about a hundredth of the field inside.
const FAR_RATIO: f64 = 2.0;
/// Distance of the field from one half up to which it is in doubt whether a point is inside.
pub(super) const DOUBT: f64 = 0.2;

/// A surface's winding field, by a hierarchy of its triangles. A question takes time that grows with the
/// logarithm of their number.
#[derive(Debug)]
pub(super) struct WindingField {
    triangles: Vec<[DVec3; 3]>,
    /// The triangles' attributes; a single one if all have the same.
    attributes: Vec<u32>,
    /// In preorder; a group's first part follows it.
    groups: Vec<Group>,
    /// Numbers of the edges that are the surface's boundary, in order.
    boundary: Vec<u64>,
    /// Least and greatest coordinates of the triangles.
    bounds: [[i32; 3]; 2],
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

impl WindingField {
    /// Bytes of memory that the field of this number of triangles takes.
    pub(super) fn memory(triangles: usize) -> u64 {
        let groups = 4 * triangles.div_ceil(LEAF);
        // While it is made, there are three numbered edges for each triangle, too.
        (triangles * (size_of::<[DVec3; 3]>() + 24 + 3 * 16) + groups * size_of::<Group>()) as u64
    }

    /// The field of these triangles.
    ///
    /// # Errors
    /// If there are more than 2^31, or on interruption.
    pub(super) fn new(triangles: &[Triangle], progress: &dyn Progress) -> Result<WindingField> {
        let boundary = boundary_edges(triangles);
        let least = |axis| triangles.iter().map(|triangle| triangle.min(axis)).min().unwrap_or(0);
        let most = |axis| triangles.iter().map(|triangle| triangle.max(axis)).max().unwrap_or(0);
        let bounds = [std::array::from_fn(least), std::array::from_fn(most)];
        progress.check()?;
        let mut sorted: Vec<(u64, u32, [DVec3; 3])> = triangles
            .iter()
            .map(|triangle| {
                let middle = |axis: usize| {
                    triangle.corners.iter().map(|corner| i64::from(corner[axis])).sum::<i64>() / 3
                };
                // Coordinates run from -2^29 to 2^30.
                let cell = |axis: usize| ((middle(axis) + (1 << 29)) >> 10) as u32;
                let key = (0..3).fold(0, |key, axis| key | morton_encode(Dimension::Oct, cell(axis)) << axis);
                (
                    key,
                    triangle.attribute,
                    triangle.corners.map(|corner| DVec3::from_array(corner.map(f64::from))),
                )
            })
            .collect();
        if sorted.len() > i32::MAX as usize {
            let found = format!("{} triangles", sorted.len());
            return Err(Error::invalid("the surface is not closed and has", found, "at most 2^31"));
        }
        sorted.sort_by_key(|(key, ..)| *key);
        progress.check()?;
        let mut attributes: Vec<u32> = sorted.iter().map(|(_, attribute, _)| *attribute).collect();
        if attributes.iter().all(|attribute| *attribute == attributes[0]) {
            attributes.truncate(1);
        }
        let triangles: Vec<_> = sorted.into_iter().map(|(.., triangle)| triangle).collect();
        let mut field = WindingField { triangles, attributes, groups: Vec::new(), boundary, bounds };
        field.group(0, field.triangles.len(), progress)?;
        Ok(field)
    }

    fn group(&mut self, first: usize, end: usize, progress: &dyn Progress) -> Result<()> {
        progress.check()?;
        let index = self.groups.len();
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
            self.group(first, middle, progress)?;
            self.group(middle, end, progress)?;
        }
        self.groups[index].next = self.groups.len() as u32;
        Ok(())
    }

    /// The field at a point, in grid steps.
    pub(super) fn at(&self, point: DVec3) -> f64 {
        self.of_groups(0, self.groups.len(), point)
    }

    /// Contribution of the groups `index .. end` to the field at a point.
    fn of_groups(&self, mut index: usize, end: usize, point: DVec3) -> f64 {
        let mut sum = 0.0;
        // Groups are in preorder and know the group behind their subtree: the walk needs no stack.
        while index < end {
            let group = &self.groups[index];
            let away = group.centre - point;
            let distance = away.length();
            if distance > FAR_RATIO * group.radius {
                sum += group.normal.dot(away) / (distance * distance * distance);
                index = group.next as usize;
            } else if group.count as usize <= LEAF {
                let triangles = &self.triangles[group.first as usize..][..group.count as usize];
                sum += triangles.iter().map(|triangle| solid_angle(triangle, point)).sum::<f64>();
                index = group.next as usize;
            } else {
                index += 1;
            }
        }
        sum / (4.0 * std::f64::consts::PI)
    }

    /// Attribute at a point inside, in grid steps: that of the nearest triangle behind which it lies, the least of
    /// several. (Of two bodies that touch, one is behind the wall and the other before it.)
    pub(super) fn attribute(&self, point: DVec3) -> u32 {
        if let [attribute] = self.attributes[..] {
            return attribute;
        }
        // In what is turned inside out, it lies before them.
        let behind = if self.at(point) < 0.0 { -1.0 } else { 1.0 };
        let (mut best, mut any) = ((f64::INFINITY, 0), (f64::INFINITY, 0));
        let mut open = if self.groups.is_empty() { Vec::new() } else { vec![0] };
        while let Some(index) = open.pop() {
            let group = &self.groups[index as usize];
            if self.least_distance(index, point).powi(2) > best.0 {
                continue;
            }
            if group.count as usize <= LEAF {
                for number in group.first as usize..(group.first + group.count) as usize {
                    let triangle @ [a, b, c] = &self.triangles[number];
                    let found = (distance_squared(triangle, point), self.attributes[number]);
                    let is_behind = (*b - *a).cross(*c - *a).dot(point - *a) * behind <= 0.0;
                    any = nearer(any, found);
                    if is_behind {
                        best = nearer(best, found);
                    }
                }
                continue;
            }
            // The nearer part first, so that it rules out the other.
            let (a, b) = (index + 1, self.groups[index as usize + 1].next);
            let is_nearer = self.least_distance(a, point) <= self.least_distance(b, point);
            open.extend(if is_nearer { [b, a] } else { [a, b] });
        }
        // (None may be there where a surface is loose.)
        if best.0.is_finite() { best.1 } else { any.1 }
    }

    /// Distance from which on a group's triangles lie; a little less, for rounding.
    fn least_distance(&self, index: u32, point: DVec3) -> f64 {
        let group = &self.groups[index as usize];
        ((group.centre.distance(point) - group.radius) * (1.0 - 1e-9) - 1e-3).max(0.0)
    }

    /// The field as it is everywhere.
    pub(super) fn everywhere(&self) -> LocalField<'_> {
        let near = if self.groups.is_empty() { Vec::new() } else { vec![0] };
        LocalField { field: self, centre: DVec3::ZERO, value: 0.0, gradient: DVec3::ZERO, near }
    }

    /// Whether a cube lies beside the box around the surface. Of a single sheet no more than half of the view is
    /// covered from there: nothing is inside, and a surface costs where it is.
    pub(super) fn is_beside(&self, min: [i32; 3], width: i32) -> bool {
        let [least, most] = self.bounds;
        let is_beside = |axis: usize| {
            let low = i64::from(min[axis]);
            low >= i64::from(most[axis]) || low + i64::from(width) <= i64::from(least[axis])
        };
        (0..3).any(is_beside)
    }

    /// Edges of a triangle that are the surface's boundary.
    pub(super) fn boundary_edges(&self, triangle: &Triangle) -> impl Iterator<Item = [[i32; 3]; 2]> {
        let edges = edges(triangle).into_iter();
        edges.filter(|[from, to]| self.boundary.binary_search(&edge_number(*from, *to).0).is_ok())
    }

    /// The winding number of a cube that no triangle reaches into; `None` where it is in doubt somewhere.
    pub(super) fn uniform(&self, min: [i32; 3], width: i32) -> Option<i32> {
        let (min, width) = (DVec3::from_array(min.map(f64::from)), f64::from(width));
        let mut answer = None;
        let corners = (0..8).map(|i| DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64));
        for at in [DVec3::splat(0.5)].into_iter().chain(corners) {
            // A little inside the cube: its corners may lie on triangles.
            let field = self.at(min + (at * 0.98 + 0.01) * width);
            let whole = field.round();
            if (field - whole).abs() > 0.5 - DOUBT || answer.is_some_and(|answer| answer != whole) {
                return None;
            }
            answer = Some(whole);
        }
        answer.map(|answer| answer as i32)
    }
}

/// The field in a ball: the far field is linear there, so that only the near field is evaluated for every
/// point.
pub(super) struct LocalField<'a> {
    field: &'a WindingField,
    centre: DVec3,
    /// Far field at the centre, and its gradient there.
    value: f64,
    gradient: DVec3,
    /// Indices of the groups in the near field.
    near: Vec<u32>,
}

/// Distance of a group from a ball, in radii of the ball, from which on its field is taken as linear in the
/// ball. The error is then less than a thirtieth of the field.
const LINEAR_RATIO: f64 = 6.0;

impl LocalField<'_> {
    /// The field in a ball inside this one.
    pub(super) fn narrow(&self, centre: DVec3, radius: f64) -> LocalField<'_> {
        let mut inner = LocalField {
            field: self.field,
            centre,
            value: self.value + self.gradient.dot(centre - self.centre),
            gradient: self.gradient,
            near: Vec::new(),
        };
        let mut open = self.near.clone();
        while let Some(index) = open.pop() {
            let group = &self.field.groups[index as usize];
            let away = group.centre - centre;
            let distance = away.length();
            // Far for every point of the ball, so that the dipole holds there, and far against the ball's own
            // size, so that its value and gradient at the centre are enough.
            if distance > (FAR_RATIO * group.radius + radius).max(LINEAR_RATIO * radius) {
                let scale = 4.0 * std::f64::consts::PI * distance.powi(3);
                let along = group.normal.dot(away);
                inner.value += along / scale;
                inner.gradient += (away * (3.0 * along / distance.powi(2)) - group.normal) / scale;
            } else if group.count as usize <= LEAF || group.radius < radius {
                inner.near.push(index);
            } else {
                let first = index + 1;
                open.extend([self.field.groups[first as usize].next, first]);
            }
        }
        inner
    }

    /// The field at a point of the ball.
    pub(super) fn at(&self, point: DVec3) -> f64 {
        let groups = self.near.iter().map(|index| {
            let end = self.field.groups[*index as usize].next;
            self.field.of_groups(*index as usize, end as usize, point)
        });
        self.value + self.gradient.dot(point - self.centre) + groups.sum::<f64>()
    }
}

fn edges(triangle: &Triangle) -> [[[i32; 3]; 2]; 3] {
    let [a, b, c] = triangle.corners;
    [[a, b], [b, c], [c, a]]
}

/// The numbers of the edges that triangles have more often in one direction than in the other, in order.
fn boundary_edges(triangles: &[Triangle]) -> Vec<u64> {
    let mut numbers: Vec<(u64, i32)> = triangles
        .iter()
        .flat_map(edges)
        .filter(|[from, to]| from != to)
        .map(|[from, to]| {
            let (number, is_forward) = edge_number(from, to);
            (number, if is_forward { 1 } else { -1 })
        })
        .collect();
    numbers.sort_unstable();
    let same = numbers.chunk_by(|a, b| a.0 == b.0);
    same.filter(|edge| edge.iter().map(|(_, way)| way).sum::<i32>() != 0).map(|edge| edge[0].0).collect()
}

/// The nearer of two triangles, each with the square of its distance and its attribute; of equally near ones that
/// with the lesser attribute.
fn nearer(one: (f64, u32), other: (f64, u32)) -> (f64, u32) {
    let is_other = other.0 < one.0 || (other.0 == one.0 && other.1 < one.1);
    if is_other { other } else { one }
}

/// Square of the distance of a point from a triangle: from its plane if it lies over the triangle, else from the
/// nearest edge.
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

/// The solid angle under which a triangle is seen, positive from its inner side (Van Oosterom and Strackee,
/// 1983).
fn solid_angle([a, b, c]: &[DVec3; 3], from: DVec3) -> f64 {
    let (a, b, c) = (*a - from, *b - from, *c - from);
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let over = a.dot(b.cross(c));
    let under = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * over.atan2(under)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_have_the_attribute_of_the_nearest_face_that_they_are_behind() {
        // Boxes in a row that share walls, each with an attribute of its own.
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
                    assert_eq!(field.attribute(point), i, "{x} {is_inverted}");
                }
            }
            triangles.iter_mut().for_each(|triangle| triangle.corners.swap(0, 1));
        }
        assert_eq!(WindingField::new(&triangles[36..48], &()).unwrap().attribute(DVec3::ZERO), 3);
        let [a, b, c] = [DVec3::ZERO, DVec3::X * 4.0, DVec3::Y * 4.0];
        for (point, expected) in [([1.0, 1.0, 3.0], 9.0), ([4.0, 4.0, 1.0], 9.0), ([-3.0, -4.0, 0.0], 25.0)] {
            assert!((distance_squared(&[a, b, c], DVec3::from_array(point)) - expected).abs() < 1e-9);
        }
    }

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
                triangles.push(Triangle { corners: [a, b, c], attribute: 0, part: 1 });
                triangles.push(Triangle { corners: [a, c, d], attribute: 0, part: 1 });
            }
        }
        let field = WindingField::new(&triangles, &()).unwrap();
        for (point, expected) in
            [([0.0, 0.0, 0.0], 1.0), ([9000.0, 0.0, 0.0], 1.0), ([0.0, 11000.0, 0.0], 0.0)]
        {
            let found = field.at(DVec3::from_array(point));
            assert!((found - expected).abs() < 0.02, "{point:?}: {found}");
        }
        assert_eq!(field.uniform([-2000; 3], 4000), Some(1));
        assert_eq!(field.uniform([9000; 3], 4000), Some(0));
        // What is far away is nearly linear.
        let (middle, radius) = (DVec3::new(9500.0, 500.0, 0.0), 400.0);
        let (everywhere, outer) = (field.everywhere(), DVec3::new(9000.0, 0.0, 0.0));
        let outer = everywhere.narrow(outer, 1500.0);
        let local = outer.narrow(middle, radius);
        for corner in 0..8 {
            let away = DVec3::new((corner & 1) as f64, (corner >> 1 & 1) as f64, (corner >> 2) as f64) - 0.5;
            let point = middle + away * radius;
            let (found, expected) = (local.at(point), field.at(point));
            assert!((found - expected).abs() < 0.02, "{point}: {found}, not {expected}");
        }
        // The upper half alone is a bowl; in its opening the field is a half.
        assert!(triangles.iter().all(|triangle| field.boundary_edges(triangle).next().is_none()));
        triangles.retain(|triangle| triangle.min(2) >= -10);
        let field = WindingField::new(&triangles, &()).unwrap();
        let edges = triangles.iter().flat_map(|triangle| field.boundary_edges(triangle));
        assert_eq!(edges.filter(|edge| edge.iter().all(|end| end[2].abs() < 10)).count(), 2 * rings as usize);
        assert!((field.at(DVec3::new(0.0, 0.0, 0.0)) - 0.5).abs() < 0.02);
        assert_eq!(field.uniform([-100; 3], 200), None);
    }
}

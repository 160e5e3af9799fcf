//! The winding field of triangles: how much of the view from a point is covered by their inner sides, less what is
//! covered by their outer sides. It is 1 inside a closed surface and 0 outside it, and something between near holes.
//!
//! Jacobson, Kavan, Sorkine-Hornung, "Robust inside-outside segmentation using generalized winding numbers"
//! (2013). The far field of a group of triangles is that of a dipole and of the moments of its normals: Barill and
//! others, "Fast winding numbers for soups and clouds" (2018).

use glam::{DMat3, DVec3};

use super::grid::Triangle;
use super::surroundings::{Facet, Far, Surroundings};
use crate::space::{Dimension, morton_encode};
use crate::{Error, Progress, Result};

/// Distance of a group from a point, in radii of the group, from which on [`WindingField::at`] takes its field as that of
/// a dipole. The error is then less than a hundredth.
const FAR_RATIO: f64 = 3.0;

/// A winding field, by a hierarchy of triangles.
#[derive(Debug)]
pub(super) struct WindingField {
    triangles: Vec<[[i32; 3]; 3]>,
    /// In preorder, down to single triangles; a group's first part follows it.
    groups: Vec<Group>,
}

#[derive(Debug)]
struct Group {
    /// Centre, weighted by area.
    centre: DVec3,
    radius: f64,
    /// Sum of the normals, as long as the triangles' areas.
    normal: DVec3,
    /// Sum over the surface of normal times distance from the centre; rows by the normal.
    moments: DMat3,
    /// Sum of the areas.
    area: f64,
    /// Norm of the second moments: sums over the surface of normal times distance times distance, which are the first
    /// that dipoles leave out.
    left_out: f64,
    /// The triangles.
    first: u32,
    count: u32,
    /// The group that follows after all parts of this one.
    next: u32,
}

/// Triangles in an order in which near ones are near each other.
///
/// # Errors
/// If there are more than 2^31, or on interruption.
pub(super) fn sorted_by_place(triangles: &[Triangle], progress: &dyn Progress) -> Result<Vec<Triangle>> {
    if triangles.len() > i32::MAX as usize {
        let found = format!("{} triangles", triangles.len());
        return Err(Error::invalid("the surface is not closed and has", found, "at most 2^31"));
    }
    progress.check()?;
    let key = |triangle: &Triangle| {
        let middle =
            |axis: usize| triangle.corners.iter().map(|corner| i64::from(corner[axis])).sum::<i64>() / 3;
        // Coordinates run from -2^29 to 2^30.
        let cell = |axis: usize| ((middle(axis) + (1 << 29)) >> 10) as u32;
        (0..3).fold(0u64, |key, axis| key | morton_encode(Dimension::Oct, cell(axis)) << axis)
    };
    let mut sorted = triangles.to_vec();
    sorted.sort_by_cached_key(key);
    progress.check()?;
    Ok(sorted)
}

/// The products of two vectors' parts, rows by the first.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// Root of the sum of squares.
fn norm(seconds: &[DMat3; 3]) -> f64 {
    seconds.iter().flat_map(|matrix| matrix.to_cols_array()).map(|x| x * x).sum::<f64>().sqrt()
}

fn wide(corner: [i32; 3]) -> DVec3 {
    DVec3::from_array(corner.map(f64::from))
}

impl WindingField {
    /// Bytes of memory that the field of this number of triangles takes.
    pub(super) fn memory(triangles: usize) -> u64 {
        (triangles * (size_of::<[[i32; 3]; 3]>() + size_of::<Triangle>() + 2 * size_of::<Group>())) as u64
    }

    /// The field of these triangles.
    ///
    /// # Errors
    /// If there are more than 2^31, or on interruption.
    pub(super) fn new(triangles: &[Triangle], progress: &dyn Progress) -> Result<WindingField> {
        let sorted = sorted_by_place(triangles, progress)?;
        let triangles: Vec<_> = sorted.iter().map(|triangle| triangle.corners).collect();
        drop(sorted);
        let mut field = WindingField { groups: Vec::with_capacity(2 * triangles.len()), triangles };
        if !field.triangles.is_empty() {
            field.group(0, field.triangles.len(), progress)?;
        }
        Ok(field)
    }

    /// Adds a group and its parts; returns its number and its second moments.
    fn group(&mut self, first: usize, end: usize, progress: &dyn Progress) -> Result<(usize, [DMat3; 3])> {
        progress.check()?;
        let index = self.groups.len();
        let count = (end - first) as u32;
        let corners = self.triangles[first].map(wide);
        let [a, b, c] = corners;
        let centre = (a + b + c) / 3.0;
        let normal = (b - a).cross(c - a) / 2.0;
        let area = normal.length();
        let radius = corners.map(|corner| corner.distance(centre)).into_iter().fold(0.0, f64::max);
        let (from, next) = (first as u32, index as u32 + 1);
        // Over a triangle, the mean of the squared distance is a twelfth of the sum of its corners'.
        let squares =
            corners.map(|corner| outer(corner - centre, corner - centre)).into_iter().sum::<DMat3>() / 12.0;
        let seconds = normal.to_array().map(|normal| squares * normal);
        let left_out = norm(&seconds);
        let group =
            Group { centre, radius, normal, moments: DMat3::ZERO, area, left_out, first: from, count, next };
        self.groups.push(group);
        if count == 1 {
            return Ok((index, seconds));
        }
        let middle = first.midpoint(end);
        let parts = [self.group(first, middle, progress)?, self.group(middle, end, progress)?];
        let next = self.groups.len() as u32;
        let [one, other] = [0, 1].map(|part| &self.groups[parts[part].0]);
        let area = one.area + other.area;
        let centre =
            if area > 0.0 { (one.centre * one.area + other.centre * other.area) / area } else { one.centre };
        let (normal, moments) = (DVec3::ZERO, DMat3::ZERO);
        let mut whole =
            Group { centre, radius: 0.0, normal, moments, area, left_out: 0.0, first: from, count, next };
        let mut seconds = [DMat3::ZERO; 3];
        for (part, (_, part_seconds)) in [one, other].into_iter().zip(parts) {
            let away = part.centre - centre;
            whole.radius = whole.radius.max(away.length() + part.radius);
            whole.normal += part.normal;
            whole.moments += part.moments + outer(part.normal, away);
            for axis in 0..3 {
                let moments = part.moments.row(axis);
                seconds[axis] += part_seconds[axis]
                    + outer(moments, away)
                    + outer(away, moments)
                    + outer(away, away) * part.normal[axis];
            }
        }
        whole.left_out = norm(&seconds);
        self.groups[index] = whole;
        Ok((index, seconds))
    }

    /// The field at a point, in grid steps; off by less than a hundredth of how much of the view is covered.
    pub(super) fn at(&self, point: DVec3) -> f64 {
        let (mut sum, mut index) = (0.0, 0);
        // Groups are in preorder and know the group behind their subtree: the walk needs no stack.
        while let Some(group) = self.groups.get(index) {
            let away = group.centre - point;
            let distance = away.length();
            if distance > FAR_RATIO * group.radius {
                let cube = distance.powi(3);
                let moments = group.moments.x_axis.x + group.moments.y_axis.y + group.moments.z_axis.z
                    - 3.0 * away.dot(group.moments * away) / (distance * distance);
                sum += (group.normal.dot(away) + moments) / cube;
                index = group.next as usize;
            } else if group.count == 1 {
                sum += solid_angle(&self.triangles[group.first as usize].map(|corner| wide(corner) - point));
                index += 1;
            } else {
                index += 1;
            }
        }
        sum / (4.0 * std::f64::consts::PI)
    }

    /// The field at a grid point, by the solid angles of all triangles: exact but for rounding, which is far below a
    /// millionth. Points on a triangle are taken to lie beside it, where the lattice of cells is thought to be: see
    /// [`Projected`](super::crossing::Projected).
    pub(super) fn exact(&self, point: [i32; 3]) -> f64 {
        let sum: f64 = self.triangles.iter().map(|corners| exact_solid_angle(corners, point)).sum();
        sum / (4.0 * std::f64::consts::PI)
    }

    /// The field around a cube: groups that are `ratio` of their radii away from the ball around it, and `clear`
    /// half widths of the cube from the cube itself, as dipoles; all others as triangles. `step` is the length that
    /// becomes 1.
    pub(super) fn around(
        &self,
        middle: [i32; 3],
        half: f64,
        step: f64,
        ratio: f64,
        clear: f64,
    ) -> Surroundings {
        let centre = wide(middle);
        let ball = half * 3f64.sqrt();
        let mut found = Surroundings::new((half / step) as f32);
        let mut index = 0;
        while let Some(group) = self.groups.get(index) {
            let away = group.centre - centre;
            // Distance of the group's triangles from the cube, at least.
            let gap = (away.abs() - half).max(DVec3::ZERO).length() - group.radius;
            if gap > clear * half && away.length() - ball > ratio * group.radius {
                let gap = gap / step;
                found.push_far(Far {
                    centre: (away / step).as_vec3().into(),
                    normal: (group.normal / step.powi(2)).as_vec3().into(),
                    moments: (group.moments * step.powi(-3)).as_mat3().to_cols_array_2d(),
                });
                let area = group.area / step.powi(2);
                // Half the second moments times third derivatives of the inverse distance, of which none is greater than
                // 3! over its fourth power.
                let left_out = 3.0 * group.left_out / step.powi(4) / (gap + group.radius / step).powi(4);
                found.add_error(left_out, area / gap.powi(6));
                index = group.next as usize;
            } else if group.count == 1 {
                let corners =
                    self.triangles[group.first as usize].map(|corner| (wide(corner) - centre) / step);
                found.push_near(Facet::new(corners));
                index += 1;
            } else {
                index += 1;
            }
        }
        found
    }

    /// The triangles.
    pub(super) fn triangles(&self) -> &[[[i32; 3]; 3]] {
        &self.triangles
    }
}

/// The solid angle under which a triangle is seen from the origin, positive from its inner side (Van Oosterom and
/// Strackee, 1983).
fn solid_angle([a, b, c]: &[DVec3; 3]) -> f64 {
    let (over, under) = half_tangent(&[*a, *b, *c]);
    2.0 * over.atan2(under)
}

/// The tangent of half the solid angle, as a quotient.
fn half_tangent([a, b, c]: &[DVec3; 3]) -> (f64, f64) {
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let over = a.dot((*b - *a).cross(*c - *a));
    (over, la * lb * lc + a.dot(*b) * lc + b.dot(*c) * la + c.dot(*a) * lb)
}

/// The solid angle of a triangle from a grid point, which side of it the point lies on being exact.
fn exact_solid_angle(corners: &[[i32; 3]; 3], point: [i32; 3]) -> f64 {
    let at = wide(point);
    let (over, under) = half_tangent(&corners.map(|corner| wide(corner) - at));
    if under > 0.0 {
        return 2.0 * over.atan2(under);
    }
    let normal = Triangle { corners: *corners, attribute: 0, part: 0 }.normal();
    let away = |axis: usize| i128::from(corners[0][axis]) - i128::from(point[axis]);
    let height: i128 = (0..3).map(|axis| i128::from(normal[axis]) * away(axis)).sum();
    // On the plane, the point is moved by an infinitesimal vector, by far the most along x and the least along z.
    let side = if height != 0 {
        height.signum() as i64
    } else {
        -normal.into_iter().find(|n| *n != 0).unwrap_or(0).signum()
    };
    2.0 * over.abs().copysign(side as f64).atan2(under)
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(in super::super) fn ball(rings: i32, radius: f64) -> Vec<Triangle> {
        let point = |i: i32, j: i32| {
            let angle = |i: i32| f64::from(i) * std::f64::consts::PI / f64::from(rings);
            let (a, b) = (angle(i), angle(j));
            [a.sin() * b.cos(), a.sin() * b.sin(), a.cos()].map(|x| (x * radius).round() as i32)
        };
        let mut triangles = Vec::new();
        for (i, j) in (0..rings).flat_map(|i| (0..2 * rings).map(move |j| (i, j))) {
            let (a, b, c, d) = (point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1));
            triangles.push(Triangle { corners: [a, b, c], attribute: 0, part: 1 });
            triangles.push(Triangle { corners: [a, c, d], attribute: 0, part: 1 });
        }
        triangles
    }

    #[test]
    fn the_field_is_one_inside_and_zero_outside_and_half_in_a_hole() {
        let mut triangles = ball(24, 10000.0);
        let field = WindingField::new(&triangles, &()).unwrap();
        for (point, expected) in [([0, 0, 0], 1.0), ([9000, 0, 0], 1.0), ([0, 11000, 0], 0.0)] {
            let found = [field.at(wide(point)), field.exact(point)];
            assert!((found[0] - expected).abs() < 0.01, "{point:?}: {found:?}");
            assert!((found[1] - expected).abs() < 1e-9, "{point:?}: {found:?}");
        }
        triangles.retain(|triangle| triangle.min(2) >= -10);
        let field = WindingField::new(&triangles, &()).unwrap();
        assert!((field.exact([0, 0, 0]) - 0.5).abs() < 1e-9);
        // On a triangle and on its corner, the field is that beside it: by rounding neither is a half.
        let flat =
            [[[0, 0, 0], [8, 0, 0], [0, 8, 0]]].map(|corners| Triangle { corners, attribute: 0, part: 1 });
        let field = WindingField::new(&flat, &()).unwrap();
        assert!((field.exact([2, 2, 0]).abs() - 0.5).abs() < 1e-9);
        assert!(field.exact([9, 9, 0]).abs() < 1e-9);
    }

    #[test]
    fn surroundings_are_near_the_exact_field() {
        let mut state = 5u64;
        let mut random = |below: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            ((state >> 33) % below) as i32
        };
        let step = 1 << 10;
        let triangles: Vec<Triangle> = (0..400)
            .map(|_| {
                let from = [0; 3].map(|_| random(64 << 10));
                let corners = [0; 3].map(|_| from.map(|x| x + random(6 << 10)));
                Triangle { corners, attribute: 0, part: 1 }
            })
            .collect();
        let field = WindingField::new(&triangles, &()).unwrap();
        for _ in 0..40 {
            let middle = [0; 3].map(|_| random(64 << 10));
            let points: Vec<[i32; 3]> =
                (0..20).map(|_| middle.map(|x| x - 4 * step + random(8 << 10))).collect();
            let local: Vec<[f32; 3]> = points
                .iter()
                .map(|point| std::array::from_fn(|axis| (point[axis] - middle[axis]) as f32 / step as f32))
                .collect();
            for (ratio, clear) in [(f64::INFINITY, 0.0), (2.0, 0.0), (3.0, 3.0)] {
                let around = field.around(middle, f64::from(4 * step), f64::from(step), ratio, clear);
                let mut found = vec![0.0; points.len()];
                let mut rounding = vec![0.0; points.len()];
                around.add_near(&local, &mut found, &mut rounding);
                around.add_far(&local, &mut found);
                for (i, point) in points.iter().enumerate() {
                    let expected = field.exact(*point);
                    let bound = around.error() + rounding[i];
                    assert!(
                        (f64::from(found[i]) - expected).abs() <= f64::from(bound) + 1e-6,
                        "{} {expected} {bound}",
                        found[i]
                    );
                }
                if ratio == f64::INFINITY {
                    let sure = rounding.iter().filter(|rounding| **rounding < 1e-3).count();
                    assert!(sure > 15, "{rounding:?}");
                }
            }
        }
    }
}

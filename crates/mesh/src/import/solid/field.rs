//! Winding field of a surface that may be open: the fraction of the view from a point that the
//! surface's inner side covers. It is 1 inside of a closed surface, 0 outside, and in between near
//! holes.
//!
//! Jacobson, Kavan, Sorkine-Hornung, "Robust inside-outside segmentation using generalized winding
//! numbers" (2013). The far field of a group of triangles is that of a dipole with the moments of
//! its normals: Barill and others, "Fast winding numbers for soups and clouds" (2018).
//! "Fast winding numbers for soups and clouds" (2018).

use std::f64::consts::PI;

use glam::{DMat3, DVec3};

use super::grid::{Triangle, place_key};
use super::rim::Rims;

use spinney_base::{Error, Progress, Result, sort};

/// Maximum number of triangles in a leaf group; they are evaluated individually.
pub(super) const LEAF: u32 = 4;
/// Minimum distance of a group's centre from a point, in radii of the group, for the dipole
/// approximation.
const FAR_RATIO: f64 = 1.5;
/// Error bound of a dipole. Tens of dipoles contribute to a value, with independent errors.
const DIPOLE_ERROR: f64 = 6e-4;
/// Error bound of the interpolation of a group's field: more than ten times the actual error.
const GROUP_ERROR: f64 = 3e-2;
/// Factor that keeps radii upper bounds after rounding to `f32`, including the rounding of the
/// distances.
const ROUNDED_UP: f64 = 1.0 + 1e-6;
const _: () = assert!(ROUNDED_UP > 1.0 + 8.0 * (f32::EPSILON / 2.0) as f64);
/// Maximum difference of the field from one half at which it is in doubt whether a point is inside.
pub(super) const DOUBT: f64 = 0.2;

/// Winding field of a surface, as a hierarchy of its triangles.
#[derive(Debug)]
pub(super) struct WindingField {
    pub(super) triangles: Vec<[[i32; 3]; 3]>,
    /// Attributes of the triangles; a single one if all are equal.
    pub(super) attributes: Vec<u32>,
    /// Groups in preorder; a group's first child follows it.
    pub(super) groups: Vec<Group>,
    pub(super) rims: Rims,
    /// Minimum and maximum coordinates of the triangles.
    pub(super) bounds: [[i32; 3]; 2],
}

/// Group of triangles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Group {
    /// Area-weighted centre.
    pub(super) centre: DVec3,
    pub(super) radius: f32,
    /// Sum of the normals, whose lengths are the triangles' areas.
    pub(super) normal: [f32; 3],
    /// See [`Far::moments`](super::surroundings::Far::moments).
    pub(super) moments: [f32; 6],
    area: f32,
    /// Norm of the second moments: surface integrals of normal times distance times distance, the
    /// first terms that the dipole omits.
    left_out: f32,
    /// Range of the triangles.
    pub(super) first: u32,
    pub(super) count: u32,
    /// Its first child, and the next group after all of its descendants.
    part: u32,
    pub(super) next: u32,
}

/// Moments of a surface.
#[derive(Clone, Copy)]
struct Moments {
    centre: DVec3,
    radius: f64,
    area: f64,
    normal: DVec3,
    /// Integral of normal times distance from the centre; rows by the normal's component.
    firsts: DMat3,
    /// Integrals of each component of the normal times distance times distance.
    seconds: [DMat3; 3],
}

impl Moments {
    fn of(corners: [DVec3; 3]) -> Moments {
        let [a, b, c] = corners;
        let centre = (a + b + c) / 3.0;
        let normal = (b - a).cross(c - a) / 2.0;
        let away = corners.map(|corner| corner - centre);
        // Over a triangle, the mean squared distance is a twelfth of the sum of its vertices'
        // squares.
        let squares = away.map(|away| outer(away, away)).into_iter().sum::<DMat3>() / 12.0;
        Moments {
            centre,
            radius: away.map(DVec3::length).into_iter().fold(0.0, f64::max),
            area: normal.length(),
            normal,
            firsts: DMat3::ZERO,
            seconds: normal.to_array().map(|normal| squares * normal),
        }
    }

    fn sum(parts: &[Moments]) -> Moments {
        let area: f64 = parts.iter().map(|part| part.area).sum();
        let weighted: DVec3 = parts.iter().map(|part| part.centre * part.area).sum();
        let centre = if area > 0.0 { weighted / area } else { parts[0].centre };
        let (normal, firsts) = (DVec3::ZERO, DMat3::ZERO);
        let mut whole = Moments { centre, radius: 0.0, area, normal, firsts, seconds: [DMat3::ZERO; 3] };
        for part in parts {
            let away = part.centre - centre;
            whole.radius = whole.radius.max(away.length() + part.radius);
            whole.normal += part.normal;
            whole.firsts += part.firsts + outer(part.normal, away);
            for axis in 0..3 {
                let firsts = part.firsts.row(axis);
                whole.seconds[axis] += part.seconds[axis]
                    + outer(firsts, away)
                    + outer(away, firsts)
                    + outer(away, away) * part.normal[axis];
            }
        }
        whole
    }

    fn group(&self, [first, end]: [usize; 2], [index, next]: [usize; 2]) -> Group {
        let m = &self.firsts;
        let both = |i: usize, j: usize| (m.row(i)[j] + m.row(j)[i]) as f32;
        let along = |i: usize| m.row(i)[i] as f32;
        let squares = self.seconds.iter().flat_map(|matrix| matrix.to_cols_array()).map(|x| x * x);
        Group {
            centre: self.centre,
            radius: (self.radius * ROUNDED_UP) as f32,
            normal: self.normal.as_vec3().into(),
            moments: [along(0), along(1), along(2), both(0, 1), both(0, 2), both(1, 2)],
            area: self.area as f32,
            left_out: squares.sum::<f64>().sqrt() as f32,
            first: first as u32,
            count: (end - first) as u32,
            part: index as u32 + 1,
            next: next as u32,
        }
    }
}

/// Outer product of two vectors, rows by the first one.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

pub(super) fn wide(corner: [i32; 3]) -> DVec3 {
    DVec3::from_array(corner.map(f64::from))
}

impl Group {
    /// Group of a single triangle.
    fn of(number: u32, [a, b, c]: [DVec3; 3]) -> Group {
        let centre = (a + b + c) / 3.0;
        let normal = (b - a).cross(c - a) / 2.0;
        let squares = [a, b, c].map(|corner| corner.distance_squared(centre));
        let area = normal.length();
        Group {
            centre,
            radius: (squares[0].max(squares[1]).max(squares[2]).sqrt() * ROUNDED_UP) as f32,
            normal: normal.as_vec3().into(),
            moments: [0.0; 6],
            area: area as f32,
            // (The trace of the second moments, which is an upper bound of their norm.)
            left_out: (area * squares.iter().sum::<f64>() / 12.0) as f32,
            first: number,
            count: 1,
            part: 0,
            next: 0,
        }
    }

    pub(super) fn is_triangle(&self) -> bool {
        self.part == 0
    }

    /// Whether the dipole approximation holds at this distance from the centre.
    pub(super) fn is_dipole(&self, distance: f64) -> bool {
        distance >= FAR_RATIO * f64::from(self.radius)
            // Half of the second moments times third derivatives of the inverse distance, each of
            // which is at most 3! over the distance's fourth power.
            && 3.0 * f64::from(self.left_out) <= DIPOLE_ERROR * 4.0 * PI * distance.powi(4)
    }

    /// Whether its field is nearly cubic in a cube with this half width, at least `gap` away from
    /// the group.
    pub(super) fn is_cubic(&self, gap: f64, half: f64) -> bool {
        if gap <= 0.0 {
            return false;
        }
        // Bounds of the fourth derivatives divided by 24: by area, by edge length, and for three
        // edges of any length.
        let mut bend = 5.0 * f64::from(self.area) / gap.powi(2);
        if self.count == 1 {
            bend = bend.min(6.0 * f64::from(self.radius) / gap).min(4.0);
        }
        bend * (half / gap).powi(4) * SPREAD <= GROUP_ERROR * 4.0 * PI
    }
}

/// Error bound of interpolation at Chebyshev nodes: see [`Cubic::spread`].
pub(super) const SPREAD: f64 = 0.125 * (1.0 + 1.85 + 1.85 * 1.85);

impl WindingField {
    /// Memory in bytes of the field of this number of triangles.
    pub(super) fn memory(triangles: usize) -> u64 {
        let groups = 4 * triangles.div_ceil(LEAF as usize);
        // Includes the sorted copy of the triangles during construction.
        let each = size_of::<[[i32; 3]; 3]>() + 4 + size_of::<Triangle>() + 16;
        (triangles * each + groups * size_of::<Group>()) as u64 + Rims::memory(triangles)
    }

    /// Field of these triangles.
    ///
    /// # Errors
    /// If there are more than about 700 million triangles (2^31 / 3), or on cancellation.
    pub(super) fn new(triangles: &[Triangle], progress: &dyn Progress) -> Result<WindingField> {
        if triangles.len() > i32::MAX as usize / 3 {
            let found = format!("{} triangles", triangles.len());
            return Err(Error::invalid("open surface", found, "at most 700 million"));
        }
        let least = |axis| triangles.iter().map(|triangle| triangle.min(axis)).min().unwrap_or(0);
        let most = |axis| triangles.iter().map(|triangle| triangle.max(axis)).max().unwrap_or(0);
        let bounds = [std::array::from_fn(least), std::array::from_fn(most)];
        progress.check()?;
        let rims = Rims::new(triangles);
        progress.check()?;
        let middle = |triangle: &Triangle| {
            let sum =
                |axis: usize| triangle.corners.iter().map(|corner| i64::from(corner[axis])).sum::<i64>();
            [0, 1, 2].map(|axis| (sum(axis) / 3) as i32)
        };
        let mut sorted = triangles.to_vec();
        sort::by_key(&mut sorted, |triangle| place_key(middle(triangle)));
        progress.check()?;
        let mut attributes: Vec<u32> = sorted.iter().map(|triangle| triangle.attribute).collect();
        if attributes.iter().all(|attribute| *attribute == attributes[0]) {
            attributes.truncate(1);
        }
        let triangles: Vec<_> = sorted.iter().map(|triangle| triangle.corners).collect();
        drop(sorted);
        let mut field = WindingField { triangles, attributes, groups: Vec::new(), rims, bounds };
        if !field.triangles.is_empty() {
            field.group(0, field.triangles.len(), progress)?;
        }
        Ok(field)
    }

    fn group(&mut self, first: usize, end: usize, progress: &dyn Progress) -> Result<Moments> {
        progress.check()?;
        let index = self.groups.len();
        let moments = if end - first > LEAF as usize {
            let middle = first.midpoint(end);
            // (Placeholder until the moments are known.)
            self.groups.push(Moments::of([DVec3::ZERO; 3]).group([first, end], [index, 0]));
            Moments::sum(&[self.group(first, middle, progress)?, self.group(middle, end, progress)?])
        } else {
            let parts = self.triangles[first..end].iter().map(|corners| Moments::of(corners.map(wide)));
            let moments = Moments::sum(&parts.collect::<Vec<_>>());
            self.groups.push(moments.group([first, end], [index, 0]));
            moments
        };
        self.groups[index] = moments.group([first, end], [index, self.groups.len()]);
        Ok(moments)
    }

    /// Appends a group's children to a list; a triangle has none.
    pub(super) fn divide(&self, group: &Group, list: &mut Vec<Group>) {
        if group.count <= LEAF {
            let numbers = group.first..group.first + group.count;
            list.extend(numbers.map(|number| Group::of(number, self.triangles[number as usize].map(wide))));
        } else {
            let first = &self.groups[group.part as usize];
            list.extend([self.groups[first.next as usize], *first]);
        }
    }

    /// Field at a point, in grid units.
    pub(super) fn at(&self, point: DVec3) -> f64 {
        let mut sum = 0.0;
        let mut open = self.all();
        while let Some(group) = open.pop() {
            let away = group.centre - point;
            let distance = away.length();
            if group.is_dipole(distance) {
                let [xx, yy, zz, xy, xz, yz] = group.moments.map(f64::from);
                let quadratic = away.x * (xx * away.x + xy * away.y + xz * away.z)
                    + away.y * (yy * away.y + yz * away.z)
                    + zz * away.z * away.z;
                let moments = xx + yy + zz - 3.0 * quadratic / (distance * distance);
                sum += (DVec3::from(group.normal.map(f64::from)).dot(away) + moments) / distance.powi(3);
            } else if group.is_triangle() {
                sum += solid_angle(self.triangles[group.first as usize].map(|corner| wide(corner) - point));
            } else {
                self.divide(&group, &mut open);
            }
        }
        sum / (4.0 * PI)
    }

    pub(super) fn all(&self) -> Vec<Group> {
        self.groups.first().into_iter().copied().collect()
    }

    /// Whether a cube is outside of the surface's bounding box. There, a single sheet covers at
    /// most half of the view, so nothing is inside. This limits the cost to the surface's
    /// surroundings.
    pub(super) fn is_outside_bounds(&self, min: [i32; 3], width: i32) -> bool {
        let [least, most] = self.bounds;
        let is_outside_bounds = |axis: usize| {
            let low = i64::from(min[axis]);
            low >= i64::from(most[axis]) || low + i64::from(width) <= i64::from(least[axis])
        };
        (0..3).any(is_outside_bounds)
    }
}

/// Solid angle of a triangle seen from the origin, positive from its inner side (Van Oosterom and
/// Strackee, 1983).
pub(super) fn solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let over = a.dot((b - a).cross(c - a));
    let under = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * over.atan2(under)
}

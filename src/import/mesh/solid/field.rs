//! The winding field of a surface that need not be closed: how much of the view from a point is covered by
//! the surface's inner side, 1 inside a closed one and 0 outside it, and something between near holes.
//!
//! Jacobson, Kavan, Sorkine-Hornung, "Robust inside-outside segmentation using generalized winding numbers"
//! (2013); the far field of a group of triangles is that of a dipole with the moments of its normals: Barill and others,
//! "Fast winding numbers for soups and clouds" (2018); what is far from a cube is interpolated in it, and handed down to
//! the cubes in it: Fong and Darve, "The black-box fast multipole method" (2009).
//!
//! Fields are in error by less than [`BOUND`]: by what dipoles leave out, by interpolation and by rounding, each of which
//! the constants below keep to a part of it. On which side of a triangle a point lies is exact.

use std::f64::consts::PI;

use glam::{DMat3, DVec3};

use super::cubic::{ALL, CHEBYSHEV, NODES, interpolate, weights};
use super::fill::change;
use super::grid::Triangle;
use super::rim::{Rim, Rims};
use super::surroundings::{Far, Surroundings};
use crate::space::{Dimension, morton_encode};
use crate::{Error, Progress, Result};

/// Triangles that are looked at one by one.
pub(super) const LEAF: usize = 4;
/// Distance of a group's centre from a point, in radii of the group, from which on its field may be that of a dipole.
const FAR_RATIO: f64 = 1.5;
/// What a dipole may leave out.
const DIPOLE_ERROR: f64 = 1e-3;
/// Error of the interpolation of a group's field.
const GROUP_ERROR: f64 = 1e-3;
/// Least distance of a dipole, in cells: nearer ones are triangles that a point may lie on.
const LEAST_DISTANCE: f64 = 0.125;
/// Error of the field up to which cells whose field is near one half may be inside or outside.
#[cfg(test)]
const BOUND: f64 = 0.02;
/// Distance of the field from one half up to which it is in doubt whether a point is inside.
pub(super) const DOUBT: f64 = 0.2;

/// A surface's winding field, by a hierarchy of its triangles.
#[derive(Debug)]
pub(super) struct WindingField {
    pub(super) triangles: Vec<[[i32; 3]; 3]>,
    /// The triangles' attributes; a single one if all have the same.
    pub(super) attributes: Vec<u32>,
    /// In preorder; a group's first part follows it.
    pub(super) groups: Vec<Group>,
    rims: Rims,
    /// Least and greatest coordinates of the triangles.
    pub(super) bounds: [[i32; 3]; 2],
}

/// Some triangles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Group {
    /// Centre, weighted by area.
    pub(super) centre: DVec3,
    pub(super) radius: f32,
    /// Sum of the normals, as long as the triangles' areas.
    normal: [f32; 3],
    /// See [`Far::moments`].
    moments: [f32; 6],
    area: f32,
    /// Norm of the second moments: sums over the surface of normal times distance times distance, which are the first
    /// that dipoles leave out.
    left_out: f32,
    /// The triangles.
    pub(super) first: u32,
    pub(super) count: u32,
    /// The group that follows after all parts of this one.
    pub(super) next: u32,
}

/// Moments of a surface.
#[derive(Clone, Copy)]
struct Moments {
    centre: DVec3,
    radius: f64,
    area: f64,
    normal: DVec3,
    /// Sum of normal times distance from the centre; rows by the normal.
    firsts: DMat3,
    /// Sums of each part of the normal times distance times distance.
    seconds: [DMat3; 3],
}

impl Moments {
    fn of(corners: [DVec3; 3]) -> Moments {
        let [a, b, c] = corners;
        let centre = (a + b + c) / 3.0;
        let normal = (b - a).cross(c - a) / 2.0;
        let away = corners.map(|corner| corner - centre);
        // Over a triangle, the mean of the squared distance is a twelfth of the sum of its corners'.
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

    fn group(&self, first: usize, count: usize, next: usize) -> Group {
        let m = &self.firsts;
        let both = |i: usize, j: usize| (m.row(i)[j] + m.row(j)[i]) as f32;
        let along = |i: usize| m.row(i)[i] as f32;
        let squares = self.seconds.iter().flat_map(|matrix| matrix.to_cols_array()).map(|x| x * x);
        Group {
            centre: self.centre,
            radius: (self.radius * (1.0 + 1e-6)) as f32,
            normal: self.normal.as_vec3().into(),
            moments: [along(0), along(1), along(2), both(0, 1), both(0, 2), both(1, 2)],
            area: self.area as f32,
            left_out: squares.sum::<f64>().sqrt() as f32,
            first: first as u32,
            count: count as u32,
            next: next as u32,
        }
    }
}

/// The products of two vectors' parts, rows by the first.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

pub(super) fn wide(corner: [i32; 3]) -> DVec3 {
    DVec3::from_array(corner.map(f64::from))
}

/// A number by which near places are near each other in order.
pub(super) fn place_key(at: [i32; 3]) -> u64 {
    // Coordinates run from -2^29 to 2^30.
    let cell = |axis: usize| ((i64::from(at[axis]) + (1 << 29)) >> 10) as u32;
    (0..3).fold(0, |key, axis| key | morton_encode(Dimension::Oct, cell(axis)) << axis)
}

impl Group {
    /// Whether it is a dipole as seen from so far away from its centre.
    fn is_dipole(&self, distance: f64) -> bool {
        distance >= FAR_RATIO * f64::from(self.radius)
            // Half the second moments times third derivatives of the inverse distance, of which none is greater than 3!
            // over its fourth power.
            && 3.0 * f64::from(self.left_out) <= DIPOLE_ERROR * 4.0 * PI * distance.powi(4)
    }

    /// Whether its field is nearly cubic in a cube of this half width that is so far away from all of it.
    fn is_cubic(&self, gap: f64, half: f64) -> bool {
        if gap <= 0.0 {
            return false;
        }
        // Bounds of the fourth derivatives by 24: by the area, by edges' length, and by three edges of any length.
        let mut bend = 5.0 * f64::from(self.area) / gap.powi(2);
        if self.count == 1 {
            bend = bend.min(6.0 * f64::from(self.radius) / gap).min(4.0);
        }
        bend * (half / gap).powi(4) * SPREAD <= GROUP_ERROR * 4.0 * PI
    }
}

/// Bound of the error of interpolation by Chebyshev's nodes: see [`Cubic::spread`].
const SPREAD: f64 = 0.125 * (1.0 + 1.85 + 1.85 * 1.85);

/// What is looked at as a whole: a group, or a triangle.
#[derive(Clone, Copy, Debug)]
enum Part {
    Group(u32),
    Triangle(u32),
}

impl WindingField {
    /// Bytes of memory that the field of this number of triangles takes.
    pub(super) fn memory(triangles: usize) -> u64 {
        let groups = 4 * triangles.div_ceil(LEAF);
        // While it is made, there is a sorted copy of the triangles, too.
        let each = size_of::<[[i32; 3]; 3]>() + 4 + size_of::<Triangle>() + 16;
        (triangles * each + groups * size_of::<Group>()) as u64 + Rims::memory(triangles)
    }

    /// The field of these triangles.
    ///
    /// # Errors
    /// If there are more than 2^31, or on interruption.
    pub(super) fn new(triangles: &[Triangle], progress: &dyn Progress) -> Result<WindingField> {
        if triangles.len() > i32::MAX as usize / 3 {
            let found = format!("{} triangles", triangles.len());
            return Err(Error::invalid("the surface is not closed and has", found, "at most 700 million"));
        }
        let least = |axis| triangles.iter().map(|triangle| triangle.min(axis)).min().unwrap_or(0);
        let most = |axis| triangles.iter().map(|triangle| triangle.max(axis)).max().unwrap_or(0);
        let bounds = [std::array::from_fn(least), std::array::from_fn(most)];
        progress.check()?;
        let rims = Rims::new(triangles);
        progress.check()?;
        let middle = |triangle: &Triangle| {
            let sum = |axis: usize| triangle.corners.iter().map(|corner| i64::from(corner[axis])).sum::<i64>();
            [0, 1, 2].map(|axis| (sum(axis) / 3) as i32)
        };
        let mut sorted = triangles.to_vec();
        sorted.sort_by_cached_key(|triangle| place_key(middle(triangle)));
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
        let moments = if end - first > LEAF {
            let middle = first.midpoint(end);
            // (In its place until it is known.)
            self.groups.push(Moments::of([DVec3::ZERO; 3]).group(first, end - first, 0));
            Moments::sum(&[self.group(first, middle, progress)?, self.group(middle, end, progress)?])
        } else {
            let parts = self.triangles[first..end].iter().map(|corners| Moments::of(corners.map(wide)));
            let moments = Moments::sum(&parts.collect::<Vec<_>>());
            self.groups.push(moments.group(first, end - first, 0));
            moments
        };
        self.groups[index] = moments.group(first, end - first, self.groups.len());
        Ok(moments)
    }

    /// What is known of a part.
    fn of(&self, part: Part) -> Group {
        match part {
            Part::Group(index) => self.groups[index as usize],
            Part::Triangle(number) => {
                Moments::of(self.triangles[number as usize].map(wide)).group(number as usize, 1, 0)
            }
        }
    }

    /// Adds the parts of a part to a list; there are none of a triangle.
    fn divide(&self, part: Part, list: &mut Vec<Part>) {
        let Part::Group(index) = part else { return };
        let group = &self.groups[index as usize];
        if group.count as usize <= LEAF {
            list.extend((group.first..group.first + group.count).map(Part::Triangle));
        } else {
            list.extend([Part::Group(self.groups[index as usize + 1].next), Part::Group(index + 1)]);
        }
    }

    /// The field at a point, in grid steps.
    pub(super) fn at(&self, point: DVec3) -> f64 {
        let mut sum = 0.0;
        let mut open = self.all();
        while let Some(part) = open.pop() {
            let group = self.of(part);
            let away = group.centre - point;
            let distance = away.length();
            if group.is_dipole(distance) {
                let [xx, yy, zz, xy, xz, yz] = group.moments.map(f64::from);
                let quadratic = away.x * (xx * away.x + xy * away.y + xz * away.z)
                    + away.y * (yy * away.y + yz * away.z)
                    + zz * away.z * away.z;
                let moments = xx + yy + zz - 3.0 * quadratic / (distance * distance);
                sum += (DVec3::from(group.normal.map(f64::from)).dot(away) + moments) / distance.powi(3);
            } else if let Part::Triangle(number) = part {
                sum += solid_angle(self.triangles[number as usize].map(|corner| wide(corner) - point));
            } else {
                self.divide(part, &mut open);
            }
        }
        sum / (4.0 * PI)
    }

    fn all(&self) -> Vec<Part> {
        if self.groups.is_empty() { Vec::new() } else { vec![Part::Group(0)] }
    }

    /// The field in a cube with this middle and half width, of cells of some width.
    pub(super) fn local(&self, middle: DVec3, half: f64, cell: i32) -> LocalField<'_> {
        let rim = self.rims.around(middle, half);
        let all = self.all();
        let parent = LocalField { field: self, cell, middle, half, far: None, open: all, rim };
        parent.narrow(middle, half)
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

    /// The field in a cube that no triangle reaches into, if it is on one side of one half all over; `None` where that is
    /// in doubt somewhere.
    pub(super) fn uniform(&self, min: [i32; 3], width: i32, cell: i32, progress: &dyn Progress) -> Result<Option<f32>> {
        let half = f64::from(width) / 2.0;
        let local = self.local(wide(min) + half, half, cell);
        let error = SPREAD * local.bend();
        if error > DOUBT {
            return Ok(None);
        }
        let axes = min.map(|min| CHEBYSHEV.map(|node| min + (half * (1.0 + node)) as i32));
        let nodes = local.at_lattice([&axes[0], &axes[1], &axes[2]], NODES / 2, progress)?;
        let range = Range::of(&nodes, LEBESGUE, error);
        Ok((range.from_half() > DOUBT as f32).then_some(range.middle))
    }
}

/// The sum of nodes' weights, without their signs, in cubic interpolation by Chebyshev's nodes.
const LEBESGUE: f32 = 1.85 * 1.85 * 1.85;

/// Bounds of an interpolated field.
#[derive(Clone, Copy, Debug)]
pub(super) struct Range {
    pub(super) middle: f32,
    reach: f32,
}

impl Range {
    /// From values at nodes whose weights have this sum, without their signs, with this error.
    pub(super) fn of(nodes: &[f32], sum: f32, error: f64) -> Range {
        let least = nodes.iter().copied().fold(f32::INFINITY, f32::min);
        let most = nodes.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        Range { middle: f32::midpoint(least, most), reach: (most - least) / 2.0 * sum + error as f32 }
    }

    /// Distance from one half, up to and beyond whole numbers; negative where it may be one half.
    pub(super) fn from_half(&self) -> f32 {
        (self.middle - self.middle.floor() - 0.5).abs() - self.reach
    }
}

/// The field in a cube: what is far is interpolated there, so that only the near field is evaluated for every point.
pub(super) struct LocalField<'a> {
    field: &'a WindingField,
    /// Grid steps along a cell.
    cell: i32,
    middle: DVec3,
    half: f64,
    /// Far field at Chebyshev's nodes.
    far: Option<[f32; ALL]>,
    /// What is near.
    open: Vec<Part>,
    rim: Rim,
}

impl<'a> LocalField<'a> {
    /// The field in a cube inside this one.
    pub(super) fn narrow(&self, middle: DVec3, half: f64) -> LocalField<'a> {
        let axes: [[f64; NODES]; 3] =
            std::array::from_fn(|axis| CHEBYSHEV.map(|node| middle[axis] + half * node));
        let mut nodes = [0.0; ALL];
        if self.far.is_some() {
            nodes.copy_from_slice(&self.far_at([&axes[0], &axes[1], &axes[2]]));
        }
        let mut far = Surroundings::new(half * 3f64.sqrt() / f64::from(self.cell));
        let (mut near, mut open) = (Vec::new(), self.open.clone());
        while let Some(part) = open.pop() {
            let group = self.field.of(part);
            let distance = ((group.centre - middle).abs() - half).max(DVec3::ZERO).length();
            let radius = f64::from(group.radius);
            let is_cubic = group.is_cubic(distance - radius, half);
            if is_cubic && group.is_dipole(distance) {
                far.push_far(self.far(&group, middle));
            } else if let Part::Triangle(number) = part {
                if is_cubic {
                    far.push_near(self.corners(number, middle));
                } else {
                    near.push(part);
                }
            } else if is_cubic || radius > half {
                self.field.divide(part, &mut open);
            } else {
                near.push(part);
            }
        }
        if !far.is_empty() {
            let step = half / f64::from(self.cell);
            let place = |at: usize| {
                [at % NODES, at / NODES % NODES, at / NODES / NODES].map(|at| (CHEBYSHEV[at] * step) as f32)
            };
            far.add(&std::array::from_fn::<_, ALL, _>(place), &mut nodes, &mut [false; ALL]);
        }
        let rim = self.rim.narrow(middle, half);
        LocalField { field: self.field, cell: self.cell, middle, half, far: Some(nodes), open: near, rim }
    }

    /// A group as a dipole, from a point.
    fn far(&self, group: &Group, from: DVec3) -> Far {
        let step = 1.0 / f64::from(self.cell);
        Far {
            centre: ((group.centre - from) * step).as_vec3().into(),
            normal: group.normal.map(|normal| normal * (step * step) as f32),
            moments: group.moments.map(|moment| moment * (step * step * step) as f32),
        }
    }

    /// A triangle's corners, from a point.
    fn corners(&self, number: u32, from: DVec3) -> [DVec3; 3] {
        self.field.triangles[number as usize].map(|corner| (wide(corner) - from) / f64::from(self.cell))
    }

    /// The far field at a lattice of points, given by their coordinates along each axis.
    fn far_at(&self, axes: [&[f64]; 3]) -> Vec<f32> {
        let Some(far) = &self.far else { return vec![0.0; axes.map(<[f64]>::len).iter().product()] };
        let [x, y, z]: [Vec<_>; 3] = std::array::from_fn(|axis| {
            let place = |at: &f64| weights(&CHEBYSHEV, (at - self.middle[axis]) / self.half);
            axes[axis].iter().map(place).collect()
        });
        interpolate(far, [&x, &y, &z])
    }

    /// Bound of the fourth derivatives of the field without its steps at the surface: see [`Rim::bend`].
    pub(super) fn bend(&self) -> f64 {
        self.rim.bend(self.middle, self.half)
    }

    /// The field at a lattice of grid points in the cube, given by their coordinates along each axis, x fastest, then y,
    /// then z; near groups are found for `side` points along each axis at a time. Points on triangles lie beside them, as
    /// [`Projected`](super::crossing::Projected) has it.
    pub(super) fn at_lattice(
        &self,
        axes: [&[i32]; 3],
        side: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<f32>> {
        let [x, y, z] = axes.map(|axis| axis.iter().map(|at| f64::from(*at)).collect::<Vec<f64>>());
        let mut values = self.far_at([&x, &y, &z]);
        let counts = axes.map(<[i32]>::len);
        let starts = |axis: usize| (0..counts[axis]).step_by(side);
        let (mut points, mut indices, mut sums) = (Vec::new(), Vec::new(), Vec::new());
        for (z, y, x) in starts(2).flat_map(|z| starts(1).flat_map(move |y| starts(0).map(move |x| (z, y, x)))) {
            progress.check()?;
            points.clear();
            indices.clear();
            let range = |axis: usize, from: usize| from..(from + side).min(counts[axis]);
            for (k, j) in range(2, z).flat_map(|k| range(1, y).map(move |j| (k, j))) {
                for i in range(0, x) {
                    points.push([axes[0][i], axes[1][j], axes[2][k]]);
                    indices.push((k * counts[1] + j) * counts[0] + i);
                }
            }
            sums.clear();
            sums.resize(points.len(), 0.0);
            self.add_near(&points, &mut sums);
            for (index, sum) in indices.iter().zip(&sums) {
                values[*index] += sum;
            }
        }
        Ok(values)
    }

    /// Adds the near field at grid points that are near each other.
    fn add_near(&self, points: &[[i32; 3]], sums: &mut [f32]) {
        let extreme = |pick: fn(DVec3, DVec3) -> DVec3| points.iter().map(|at| wide(*at)).reduce(pick);
        let (Some(least), Some(most)) = (extreme(DVec3::min), extreme(DVec3::max)) else { return };
        let (middle, half) = (least.midpoint(most), (most - least) / 2.0);
        let cell = f64::from(self.cell);
        let mut around = Surroundings::new(half.length() / cell + LEAST_DISTANCE);
        let (mut open, mut near) = (self.open.clone(), Vec::new());
        while let Some(part) = open.pop() {
            let group = self.field.of(part);
            let distance = ((group.centre - middle).abs() - half).max(DVec3::ZERO).length();
            if group.is_dipole(distance) && distance > LEAST_DISTANCE * cell {
                around.push_far(self.far(&group, middle));
            } else if let Part::Triangle(number) = part {
                around.push_near(self.corners(number, middle));
                near.push(number);
            } else {
                self.field.divide(part, &mut open);
            }
        }
        let place = |at: &[i32; 3]| ((wide(*at) - middle) / cell).as_vec3().into();
        let places: Vec<[f32; 3]> = points.iter().map(place).collect();
        let mut in_doubt = vec![false; points.len()];
        around.add(&places, sums, &mut in_doubt);
        let mut doubtful: Vec<usize> = (0..points.len()).filter(|index| in_doubt[*index]).collect();
        if doubtful.is_empty() {
            return;
        }
        // Beside a triangle's plane there is no doubt, and how many triangles lie between is exact.
        let near: Vec<Triangle> = near
            .into_iter()
            .map(|number| Triangle { corners: self.field.triangles[number as usize], attribute: 0, part: 0 })
            .collect();
        for scale in [1, 8, 64] {
            let step = (self.cell >> 13).max(1) * scale;
            let beside = |index: &usize| {
                let [x, y, z] = points[*index];
                [x + 5 * step, y + 3 * step, z + 2 * step]
            };
            let moved: Vec<[i32; 3]> = doubtful.iter().map(beside).collect();
            let places: Vec<[f32; 3]> = moved.iter().map(place).collect();
            let (mut found, mut in_doubt) = (vec![0.0; moved.len()], vec![false; moved.len()]);
            around.add(&places, &mut found, &mut in_doubt);
            let mut rest = Vec::new();
            for (((index, moved), found), in_doubt) in doubtful.iter().zip(moved).zip(found).zip(in_doubt) {
                let mut at = points[*index];
                let passed = change::<0>(&near, &mut at, moved)
                    + change::<1>(&near, &mut at, moved)
                    + change::<2>(&near, &mut at, moved);
                sums[*index] = found - passed as f32;
                if in_doubt {
                    rest.push(*index);
                }
            }
            doubtful = rest;
        }
    }
}

/// The solid angle under which a triangle is seen from the origin, positive from its inner side (Van Oosterom and
/// Strackee, 1983).
fn solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let over = a.dot((b - a).cross(c - a));
    let under = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * over.atan2(under)
}

//! Winding field at many points of a cube.
//!
//! The field of distant groups is interpolated in the cube and passed down to its subcubes: Fong
//! and Darve, "The black-box fast multipole method" (2009). Near triangles, and near groups as
//! dipoles, are collected for several points together.
//!
//! Fields have an error below 0.01, from dipoles, interpolation and rounding. Tests check this; the
//! measured maximum on surfaces and soups of tens of thousands of triangles is 0.008. It is not
//! proven: the bounds of single errors are, but their independence is not. The side of a triangle
//! on which a point is located is exact. For points on a triangle within a thousandth of a cell
//! from a rim, where the field takes all values, the result is one of these values.

use glam::DVec3;

use super::cubic::{ALL, CHEBYSHEV, NODES, interpolate, weights};
use super::field::{DOUBT, Group, LEAF, SPREAD, WindingField, wide};
use super::grid::Triangle;
use super::surroundings::{Far, Surroundings};
use super::windings::change;
use spinney_base::{Progress, Result};

/// Minimum distance of a dipole in cells. Closer groups are triangles that a point may lie on.
const MIN_DISTANCE: f64 = 0.125;

impl WindingField {
    /// Field in a cube with this centre and half width. `cell` is the width of a cell.
    pub(super) fn local(&self, middle: DVec3, half: f64, cell: i32) -> LocalField<'_> {
        let parent = LocalField { field: self, cell, middle, half, far: None, open: self.all() };
        parent.narrow(middle, half)
    }

    /// Value of the field in a cube that no triangle reaches into, if the field is on one side of
    /// one half throughout; `None` where that is in doubt.
    pub(super) fn uniform(
        &self,
        min: [i32; 3],
        width: i32,
        cell: i32,
        progress: &dyn Progress,
    ) -> Result<Option<f32>> {
        let half = f64::from(width) / 2.0;
        let middle = wide(min) + half;
        let error = SPREAD * self.rims.around(middle, half).bend(middle, half, DOUBT / SPREAD);
        if error > DOUBT {
            return Ok(None);
        }
        let local = self.local(middle, half, cell);
        let axes = min.map(|min| CHEBYSHEV.map(|node| min + (half * (1.0 + node)) as i32));
        let nodes = local.at_lattice([&axes[0], &axes[1], &axes[2]], NODES / 2, progress)?;
        let range = Range::of(&nodes, LEBESGUE, error);
        Ok((range.distance_from_half() > DOUBT as f32).then_some(range.middle))
    }
}

/// Sum of the nodes' absolute weights in cubic interpolation at Chebyshev nodes.
const LEBESGUE: f32 = 1.85 * 1.85 * 1.85;

/// Bounds of an interpolated field.
#[derive(Clone, Copy, Debug)]
pub(super) struct Range {
    pub(super) middle: f32,
    reach: f32,
}

impl Range {
    /// Range of a field from its values at nodes. `sum` is the sum of the nodes' absolute weights,
    /// `error` the error of the interpolation.
    pub(super) fn of(nodes: &[f32], sum: f32, error: f64) -> Range {
        let least = nodes.iter().copied().fold(f32::INFINITY, f32::min);
        let most = nodes.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        Range { middle: f32::midpoint(least, most), reach: (most - least) / 2.0 * sum + error as f32 }
    }

    /// Distance from the nearest half-integer (n + 1/2); negative if the range may contain it.
    pub(super) fn distance_from_half(&self) -> f32 {
        (self.middle - self.middle.floor() - 0.5).abs() - self.reach
    }
}

/// Field in a cube. The far field is interpolated there, so only the near field is evaluated at
/// every point.
pub(super) struct LocalField<'a> {
    field: &'a WindingField,
    /// Width of a cell in grid units.
    cell: i32,
    middle: DVec3,
    half: f64,
    /// Far field at the Chebyshev nodes.
    far: Option<[f32; ALL]>,
    /// Groups of the near field.
    open: Vec<Group>,
}

impl<'a> LocalField<'a> {
    /// Field in a cube inside this one.
    pub(super) fn narrow(&self, middle: DVec3, half: f64) -> LocalField<'a> {
        let axes: [[f64; NODES]; 3] =
            std::array::from_fn(|axis| CHEBYSHEV.map(|node| middle[axis] + half * node));
        let mut nodes = [0.0; ALL];
        if self.far.is_some() {
            nodes.copy_from_slice(&self.far_at([&axes[0], &axes[1], &axes[2]]));
        }
        let mut far = Surroundings::new(half * 3f64.sqrt() / f64::from(self.cell));
        let (mut near, mut open) = (Vec::new(), self.open.clone());
        // In the smallest cubes, groups that are not distant are resolved to triangles once for all
        // points.
        let is_small = half <= f64::from(4 * self.cell);
        while let Some(group) = open.pop() {
            let distance = ((group.centre - middle).abs() - half).max(DVec3::ZERO).length();
            let radius = f64::from(group.radius);
            let mut gap = distance - radius;
            if group.is_triangle() {
                // The bounding ball of a large triangle extends far beyond the triangle.
                gap =
                    gap.max(gap_between(self.field.triangles[group.first as usize].map(wide), middle, half));
            }
            let is_cubic = group.is_cubic(gap, half);
            let is_dipole = group.is_dipole(distance);
            if is_cubic && is_dipole {
                far.push_far(self.far(&group, middle));
            } else if group.is_triangle() && is_cubic {
                far.push_near(self.corners(group.first, middle));
            } else if group.is_triangle() {
                near.push(group);
            } else if is_cubic || radius > half || is_small && group.count <= LEAF && !is_dipole {
                self.field.divide(&group, &mut open);
            } else {
                near.push(group);
            }
        }
        if !far.is_empty() {
            let step = half / f64::from(self.cell);
            let node = |at: usize| {
                [at % NODES, at / NODES % NODES, at / NODES / NODES].map(|at| (CHEBYSHEV[at] * step) as f32)
            };
            far.add(&std::array::from_fn::<_, ALL, _>(node), &mut nodes, &mut [false; ALL]);
        }
        LocalField { field: self.field, cell: self.cell, middle, half, far: Some(nodes), open: near }
    }

    /// Group as a dipole, relative to a point.
    fn far(&self, group: &Group, from: DVec3) -> Far {
        let step = 1.0 / f64::from(self.cell);
        Far {
            centre: ((group.centre - from) * step).as_vec3().into(),
            normal: group.normal.map(|normal| normal * (step * step) as f32),
            moments: group.moments.map(|moment| moment * (step * step * step) as f32),
        }
    }

    /// Vertices of a triangle, relative to a point.
    fn corners(&self, number: u32, from: DVec3) -> [DVec3; 3] {
        self.field.triangles[number as usize].map(|corner| (wide(corner) - from) / f64::from(self.cell))
    }

    /// Far field at a lattice of points, given by coordinates along each axis.
    fn far_at(&self, axes: [&[f64]; 3]) -> Vec<f32> {
        let Some(far) = &self.far else { return vec![0.0; axes.map(<[f64]>::len).iter().product()] };
        let [x, y, z]: [Vec<_>; 3] = std::array::from_fn(|axis| {
            let weights_at = |at: &f64| weights(&CHEBYSHEV, (at - self.middle[axis]) / self.half);
            axes[axis].iter().map(weights_at).collect()
        });
        interpolate(far, [&x, &y, &z])
    }

    /// Field at a lattice of grid points in the cube, given by coordinates along each axis; x
    /// fastest, then y, then z. Near groups are collected for `side` points along each axis at a
    /// time. Points on triangles are perturbed off them as in
    /// [`Projected`](spinney_brep::exact::lattice::Projected).
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
        for (z, y, x) in
            starts(2).flat_map(|z| starts(1).flat_map(move |y| starts(0).map(move |x| (z, y, x))))
        {
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

    /// Adds the near field at grid points that are close to each other.
    fn add_near(&self, points: &[[i32; 3]], sums: &mut [f32]) {
        let extreme = |pick: fn(DVec3, DVec3) -> DVec3| points.iter().map(|at| wide(*at)).reduce(pick);
        let (Some(least), Some(most)) = (extreme(DVec3::min), extreme(DVec3::max)) else { return };
        let (middle, half) = (least.midpoint(most), (most - least) / 2.0);
        let cell = f64::from(self.cell);
        let mut around = Surroundings::new(half.length() / cell + MIN_DISTANCE);
        let (mut open, mut near) = (self.open.clone(), Vec::new());
        while let Some(group) = open.pop() {
            let distance = ((group.centre - middle).abs() - half).max(DVec3::ZERO).length();
            if group.is_dipole(distance) && distance > MIN_DISTANCE * cell {
                around.push_far(self.far(&group, middle));
            } else if group.is_triangle() {
                around.push_near(self.corners(group.first, middle));
                near.push(group.first);
            } else {
                self.field.divide(&group, &mut open);
            }
        }
        let to_cells = |at: &[i32; 3]| ((wide(*at) - middle) / cell).as_vec3().into();
        let positions: Vec<[f32; 3]> = points.iter().map(to_cells).collect();
        let mut in_doubt = vec![false; points.len()];
        around.add(&positions, sums, &mut in_doubt);
        let mut doubtful: Vec<usize> = (0..points.len()).filter(|index| in_doubt[*index]).collect();
        if doubtful.is_empty() {
            return;
        }
        // Off the triangle's plane there is no doubt, and the number of triangles in between is
        // exact.
        let near: Vec<Triangle> = near
            .into_iter()
            .map(|number| Triangle { corners: self.field.triangles[number as usize], attribute: 0, part: 0 })
            .collect();
        for scale in [1, 8, 64] {
            let step = (self.cell >> 13).max(1) * scale;
            let neighbour = |index: &usize| {
                let [x, y, z] = points[*index];
                [x + 5 * step, y + 3 * step, z + 2 * step]
            };
            let moved: Vec<[i32; 3]> = doubtful.iter().map(neighbour).collect();
            let positions: Vec<[f32; 3]> = moved.iter().map(to_cells).collect();
            let (mut found, mut in_doubt) = (vec![0.0; moved.len()], vec![false; moved.len()]);
            around.add(&positions, &mut found, &mut in_doubt);
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

/// Lower bound of the distance between a triangle and a cube: that of its box, or of its plane.
fn gap_between(corners: [DVec3; 3], middle: DVec3, half: f64) -> f64 {
    let [a, b, c] = corners.map(|corner| corner - middle);
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let of_box = (low - half).max(-high - half).max(DVec3::ZERO).length();
    let normal = (b - a).cross(c - a);
    let sides = normal.abs();
    let of_plane = (a.dot(normal).abs() - half * (sides.x + sides.y + sides.z)) / normal.length();
    // (A triangle without area has no plane.)
    of_box.max(of_plane)
}

#[cfg(test)]
mod tests {
    use super::super::field::solid_angle;
    use super::*;

    /// Error of the field, as documented.
    const BOUND: f64 = 0.01;
    const CELL: i32 = 1 << 10;

    /// Field by its definition, at the point with its symbolic perturbation.
    fn exact(triangles: &[Triangle], at: [i32; 3]) -> f64 {
        let at = wide(at) + DVec3::new(1e-2, 1e-4, 1e-6);
        let angles =
            triangles.iter().map(|triangle| solid_angle(triangle.corners.map(|corner| wide(corner) - at)));
        angles.sum::<f64>() / (4.0 * std::f64::consts::PI)
    }

    /// Maximum error of the field in a cube of 8 x 8 x 8 cells, computed from a cube of 64 x 64 x
    /// 64.
    fn error(field: &WindingField, triangles: &[Triangle], corner: [i32; 3]) -> f64 {
        let centre = |corner: [i32; 3], half: i32| wide(corner) + f64::from(half);
        let block = field.local(centre([0; 3], 32 * CELL), f64::from(32 * CELL), CELL);
        let outer =
            block.narrow(centre(corner.map(|x| x & !(32 * CELL - 1)), 16 * CELL), f64::from(16 * CELL));
        let local = outer.narrow(centre(corner, 4 * CELL), f64::from(4 * CELL));
        let [x, y, z] = corner.map(|x| (0..8).map(|at| x + at * CELL + CELL / 2).collect::<Vec<i32>>());
        let found = local.at_lattice([&x, &y, &z], 4, &()).unwrap();
        let at = |index: usize| [x[index % 8], y[index / 8 % 8], z[index / 64]];
        let off = |index: usize| (f64::from(found[index]) - exact(triangles, at(index))).abs();
        (0..512).step_by(7).map(off).fold(0.0, f64::max)
    }

    #[test]
    fn local_fields_are_as_exact_as_stated() {
        let mut state = 5u64;
        let mut random = |below: i32| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            ((state >> 33) % below as u64) as i32
        };
        for (count, size) in [(400, 40), (3000, 20), (3000, 6), (3000, 1)] {
            let triangle = |_| {
                let from = [0; 3].map(|_| random(64 * CELL));
                let corners = [0; 3].map(|_| from.map(|x| x + random(size * CELL)));
                Triangle { corners, attribute: 0, part: 1 }
            };
            let triangles: Vec<Triangle> = (0..count).map(triangle).collect();
            let field = WindingField::new(&triangles, &()).unwrap();
            let mut most = 0f64;
            for _ in 0..24 {
                most = most.max(error(&field, &triangles, [0; 3].map(|_| 8 * CELL * random(8))));
            }
            eprintln!("{count} triangles of {size} cells: off by {most:.5}");
            assert!(most < BOUND, "{count} triangles of {size} cells: {most}");
        }
    }
}

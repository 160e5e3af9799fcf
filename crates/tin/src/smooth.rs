//! Smoothing of heights.

use std::collections::BTreeMap;

use crate::mesh::{Mesh, neighbours};
use crate::tin::Tin;
use spinney_base::{Error, Progress, Result};

/// Laplacian smoothing of heights (Field 1988). In each pass, a height moves half of the way to
/// the mean of its neighbours' heights. Vertices on breaklines and at the border keep their
/// heights, so that faults stay sharp and adjacent volumes match. No height leaves the original
/// range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smoothing {
    /// Number of passes.
    pub passes: u32,
    /// Maximum movement of a height in all passes; infinite for no limit.
    pub max_distance: f64,
    /// Whether points keep their heights. Each triangle is then divided into four at the midpoints
    /// of its edges, and the midpoints move.
    pub keeps_points: bool,
}

impl Smoothing {
    /// Smoothing without a limit, in which points move.
    pub fn of_passes(passes: u32) -> Smoothing {
        Smoothing { passes, max_distance: f64::INFINITY, keeps_points: false }
    }

    /// Fails if the distance is not a positive number.
    pub(crate) fn check(&self) -> Result<()> {
        if self.max_distance > 0.0 {
            return Ok(());
        }
        Err(Error::invalid("smoothing distance", self.max_distance.to_string(), "a number above 0"))
    }
}

impl Tin {
    /// Smooths the heights. Horizontal positions do not change. Also returns the maximum movement.
    ///
    /// # Errors
    /// If the maximum distance is not positive; on cancellation.
    pub fn smoothed(&self, smoothing: &Smoothing, progress: &dyn Progress) -> Result<(Tin, f64)> {
        smoothing.check()?;
        let mut tin = self.clone();
        if smoothing.keeps_points {
            let (mesh, middles) = self.mesh.divided();
            tin.heights.extend(middles.iter().map(|ends| {
                let [a, b] = ends.map(|end| self.heights[end as usize]);
                a.midpoint(b)
            }));
            tin.mesh = mesh;
        }
        let mut is_fixed = tin.mesh.fixed();
        if smoothing.keeps_points {
            is_fixed[..self.heights.len()].fill(true);
        }
        let moved = smooth(&tin.mesh, &mut tin.heights, &is_fixed, smoothing, progress)?;
        Ok((tin, moved))
    }
}

/// Smooths heights on a mesh, except fixed ones. Returns the maximum movement.
pub(crate) fn smooth(
    mesh: &Mesh,
    heights: &mut [f64],
    is_fixed: &[bool],
    smoothing: &Smoothing,
    progress: &dyn Progress,
) -> Result<f64> {
    let before = heights.to_vec();
    for _ in 0..smoothing.passes {
        progress.check()?;
        let mut sums = vec![(0.0, 0u32); heights.len()];
        // (Around an interior vertex, each edge from it is the directed edge of exactly one
        // triangle, so each neighbour counts once.)
        for [a, b, c] in &mesh.triangles {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                sums[*from as usize].0 += heights[*to as usize];
                sums[*from as usize].1 += 1;
            }
        }
        for (vertex, height) in heights.iter_mut().enumerate() {
            let (sum, count) = sums[vertex];
            if !is_fixed[vertex] && count > 0 {
                *height += (sum / f64::from(count) - *height) / 2.0;
                let [low, high] = [-1.0, 1.0].map(|sign| before[vertex] + sign * smoothing.max_distance);
                *height = height.clamp(low, high);
            }
        }
    }
    Ok(before.iter().zip(&*heights).map(|(before, after)| (after - before).abs()).fold(0.0, f64::max))
}

impl Mesh {
    /// Returns which vertices are on constraints or at the boundary.
    pub(crate) fn fixed(&self) -> Vec<bool> {
        let mut is_fixed = vec![false; self.points.len()];
        self.constraints.iter().flatten().for_each(|end| is_fixed[*end as usize] = true);
        self.boundary().iter().flatten().for_each(|end| is_fixed[*end as usize] = true);
        is_fixed
    }

    /// Divides each triangle into four at the midpoints of its edges. Also returns the ends of the
    /// edges whose midpoints are the new vertices.
    pub(crate) fn divided(&self) -> (Mesh, Vec<[u32; 2]>) {
        let mut middles: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let edge = |a: u32, b: u32| [a.min(b), a.max(b)];
        for [a, b, c] in &self.triangles {
            for edge in [edge(*a, *b), edge(*b, *c), edge(*c, *a)] {
                middles.insert(edge, 0);
            }
        }
        let mut points = self.points.clone();
        for ([a, b], number) in &mut middles {
            *number = points.len() as u32;
            let [from, to] = [*a, *b].map(|end| self.points[end as usize]);
            points.push([0, 1].map(|axis: usize| from[axis].midpoint(to[axis])));
        }
        let mut triangles = Vec::with_capacity(4 * self.triangles.len());
        for [a, b, c] in &self.triangles {
            let [of_ab, of_bc, of_ca] = [edge(*a, *b), edge(*b, *c), edge(*c, *a)].map(|edge| middles[&edge]);
            triangles.extend([[*a, of_ab, of_ca], [of_ab, *b, of_bc], [of_ca, of_bc, *c]]);
            triangles.push([of_ab, of_bc, of_ca]);
        }
        let halves = |ends: &[u32; 2]| match middles.get(ends) {
            Some(middle) => vec![[ends[0], *middle], [ends[1], *middle]],
            None => vec![*ends],
        };
        let mut constraints: Vec<[u32; 2]> = self.constraints.iter().flat_map(halves).collect();
        constraints.sort_unstable();
        let neighbours = neighbours(&triangles);
        (Mesh { points, triangles, neighbours, constraints }, middles.into_keys().collect())
    }
}

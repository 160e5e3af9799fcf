//! Triangulated surfaces.

use crate::mesh::{Mesh, NONE, neighbours, side};
use crate::overlap::check_overlaps;
use crate::surface::{DistinctPoints, Duplicates, SurfaceReport};
use spinney_base::Result;

/// A surface over the plane: triangles with a height at each vertex, linear in between.
#[derive(Clone, Debug)]
pub struct Tin {
    pub(crate) mesh: Mesh,
    pub(crate) heights: Vec<f64>,
}

impl Tin {
    /// Creates a surface from existing triangles, such as those of a mesh file. Corners at the same
    /// position become one vertex. Triangles without a horizontal area are dropped.
    ///
    /// # Errors
    /// If a coordinate is not finite; if corners at the same position have different heights; if
    /// triangles overlap.
    pub fn from_triangles(triangles: &[[[f64; 3]; 3]]) -> Result<Tin> {
        let corners: Vec<[f64; 3]> = triangles.iter().flatten().copied().collect();
        let distinct = DistinctPoints::of(&corners, Duplicates::Refuse, &mut SurfaceReport::default())?;
        let mut turned = Vec::with_capacity(triangles.len());
        for corners in triangles {
            let [a, b, c] = corners.map(|[x, y, _]| [x, y]);
            let area = side(a, b, c);
            let (Some(a), Some(b), Some(c)) = (distinct.number(a), distinct.number(b), distinct.number(c))
            else {
                continue;
            };
            if area != 0.0 {
                turned.push(if area > 0.0 { [a, b, c] } else { [a, c, b] });
            }
        }
        if !turned.is_empty() {
            check_overlaps(&distinct.positions, &turned)?;
        }
        let neighbours = neighbours(&turned);
        let mesh =
            Mesh { points: distinct.positions, neighbours, triangles: turned, constraints: Vec::new() };
        Ok(Tin { mesh, heights: distinct.heights })
    }

    /// Returns the vertices.
    pub fn vertices(&self) -> impl ExactSizeIterator<Item = [f64; 3]> + '_ {
        self.mesh.points.iter().zip(&self.heights).map(|([x, y], z)| [*x, *y, *z])
    }

    /// Returns the triangles by their vertex indices, counterclockwise as seen from above.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.mesh.triangles
    }

    /// Returns the edges of breaklines and outlines, each with its lower vertex index first, in
    /// ascending order.
    pub fn constraints(&self) -> &[[u32; 2]] {
        &self.mesh.constraints
    }

    /// Returns the minimum and maximum height, or `None` if there is no triangle.
    pub fn range(&self) -> Option<(f64, f64)> {
        let corners = self.mesh.triangles.iter().flatten().map(|corner| self.heights[*corner as usize]);
        corners.fold(None, |range, height| match range {
            None => Some((height, height)),
            Some((least, most)) => Some((height.min(least), height.max(most))),
        })
    }

    /// Returns the height at a position, or `None` outside of the surface. At a vertex it is
    /// exactly the vertex's height.
    pub fn height(&self, position: [f64; 2]) -> Option<f64> {
        self.height_near(position, &mut 0)
    }

    /// Returns the height at a position. The search starts at triangle `near`, which is set to the
    /// triangle found.
    pub(crate) fn height_near(&self, position: [f64; 2], near: &mut usize) -> Option<f64> {
        self.mesh.find(position, near).map(|triangle| self.height_in(triangle, position))
    }

    /// Returns the height at a position of a surface with a convex boundary. Outside, it is the
    /// height of the nearest point on the boundary. Also returns whether the position is outside.
    pub(crate) fn extended(
        &self,
        position: [f64; 2],
        near: &mut usize,
        boundary: &[[u32; 2]],
    ) -> (f64, bool) {
        if let Some(triangle) = self.mesh.locate(position, near) {
            return (self.height_in(triangle, position), false);
        }
        let mut nearest = (f64::INFINITY, 0.0);
        for [a, b] in boundary {
            let ([ax, ay], [bx, by]) = (self.mesh.points[*a as usize], self.mesh.points[*b as usize]);
            let (along, there) = ([bx - ax, by - ay], [position[0] - ax, position[1] - ay]);
            let length = along[0] * along[0] + along[1] * along[1];
            let share = ((along[0] * there[0] + along[1] * there[1]) / length).clamp(0.0, 1.0);
            let away = (there[0] - share * along[0]).hypot(there[1] - share * along[1]);
            if away < nearest.0 {
                let (low, high) = (self.heights[*a as usize], self.heights[*b as usize]);
                nearest = (away, low + share * (high - low));
            }
        }
        (nearest.1, true)
    }

    /// Returns the height of a triangle's plane at a position.
    pub(crate) fn height_in(&self, triangle: usize, position: [f64; 2]) -> f64 {
        let corners = self.mesh.corners(triangle);
        let heights = self.mesh.triangles[triangle].map(|corner| self.heights[corner as usize]);
        plane_height(corners, heights, position)
    }

    /// Returns the horizontal area of the surface, and the integral of the heights over it.
    pub fn integral(&self) -> (f64, f64) {
        let (mut area, mut volume) = (0.0, 0.0);
        for (number, corners) in self.mesh.triangles.iter().enumerate() {
            let [a, b, c] = self.mesh.corners(number);
            let part = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2.0;
            area += part;
            volume += part * corners.iter().map(|corner| self.heights[*corner as usize]).sum::<f64>() / 3.0;
        }
        (area, volume)
    }

    /// Whether an edge has a triangle on one side only.
    pub(crate) fn is_at_boundary(&self, triangle: usize, edge: usize) -> bool {
        self.mesh.neighbours[triangle][edge] == NONE
    }
}

/// Returns the height at a position in a triangle's plane, exact at the corners.
pub(crate) fn plane_height([a, b, c]: [[f64; 2]; 3], heights: [f64; 3], position: [f64; 2]) -> f64 {
    if let Some(at) = [a, b, c].iter().position(|corner| *corner == position) {
        return heights[at];
    }
    let cross = |u: [f64; 2], v: [f64; 2]| u[0] * v[1] - u[1] * v[0];
    let from = |p: [f64; 2]| [p[0] - a[0], p[1] - a[1]];
    let (u, v, w) = (from(b), from(c), from(position));
    let all = cross(u, v);
    let (of_b, of_c) = (cross(w, v) / all, cross(u, w) / all);
    // (Clamped, so that rounding never yields a height outside of the corners' range.)
    let height = heights[0] + of_b * (heights[1] - heights[0]) + of_c * (heights[2] - heights[0]);
    height.clamp(
        heights.into_iter().fold(f64::INFINITY, f64::min),
        heights.into_iter().fold(f64::NEG_INFINITY, f64::max),
    )
}

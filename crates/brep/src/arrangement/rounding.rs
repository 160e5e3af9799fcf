//! Rounding of faces with off-grid vertices to the grid.

use super::delaunay;
use super::exact_face::ExactFace;
use super::overlay::Corner;
use super::point::ExactPlane;
use crate::Face;
use crate::exact::vector::others;
use crate::face_triangle::FaceTriangle;
use crate::geometry::Triangulator;
use spinney_base::Result;

/// Moves the vertices of faces to the nearest grid points; keeps its buffers from face to face.
#[derive(Default)]
pub(super) struct Rounder {
    /// Maximum distance that a vertex was moved, in grid units.
    pub(super) displacement: f64,
    /// Whether any vertex was moved.
    pub(super) is_moved: bool,
    /// Rounded vertices of all faces.
    pub(super) corners: Vec<[i32; 3]>,
    triangulator: Triangulator,
    /// Vertices before and after rounding.
    near: Vec<[f64; 3]>,
    points: Vec<[i32; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl Rounder {
    /// Yields a rounded face: as a polygon if its rounded vertices are in its plane, otherwise as
    /// triangles. The triangulation is computed before rounding, so that slivers collapse instead
    /// of folding over.
    pub(super) fn round(
        &mut self,
        face: &ExactFace,
        each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
    ) -> Result<()> {
        self.near.clear();
        self.points.clear();
        for Corner { point, .. } in &face.corners {
            let moved = point.rounded();
            self.is_moved |= point.on_grid().is_none();
            let squares = (0..3).map(|axis| (point.near[axis] - f64::from(moved[axis])).powi(2));
            self.displacement = self.displacement.max(squares.sum::<f64>().sqrt());
            self.near.push(point.near);
            self.points.push(moved);
        }
        self.corners.extend_from_slice(&self.points);
        let ExactFace { plane, ring_ends, colours, part, source, .. } = face;
        let (part, source) = (*part, *source);
        let stays_flat = self.points.iter().all(|point| plane.height(*point) == 0);
        if stays_flat || !self.triangulate(plane, ring_ends) {
            return each(&Face { number: 0, points: &self.points, ring_ends, colours, part, source });
        }
        for triangle in &self.triangles {
            let points = triangle.map(|corner| self.points[corner as usize]);
            let colours: Vec<[u8; 3]> = match colours.is_empty() {
                true => Vec::new(),
                false => triangle.map(|corner| colours[corner as usize]).to_vec(),
            };
            each(&Face { number: 0, points: &points, ring_ends: &[3], colours: &colours, part, source })?;
        }
        Ok(())
    }

    /// Triangulates the face before its vertices are rounded, on a grid that is refined to the
    /// face's size.
    fn triangulate(&mut self, plane: &ExactPlane, ring_ends: &[usize]) -> bool {
        let least = |axis: usize| self.near.iter().map(|point| point[axis]).fold(f64::INFINITY, f64::min);
        let low = [0, 1, 2].map(least);
        let extent = self.near.iter().flat_map(|point| (0..3).map(|axis| point[axis] - low[axis]));
        // (A face that is a point is empty at any scale.)
        const MIN_EXTENT: f64 = 1e-9;
        let extent = extent.fold(MIN_EXTENT, f64::max);
        let scale = f64::from(1 << 30) / extent;
        let fine =
            |point: &[f64; 3]| [0, 1, 2].map(|axis| ((point[axis] - low[axis]) * scale).round() as i64);
        let fine: Vec<[i64; 3]> = self.near.iter().map(fine).collect();
        self.triangles.clear();
        if !self.triangulator.triangulate(&fine, ring_ends, &mut self.triangles) {
            return false;
        }
        // Without long thin triangles, rounding causes fewer intersections.
        let corners: Vec<[f64; 3]> = fine.iter().map(|point| point.map(|at| at as f64)).collect();
        delaunay::flip_in_plane(plane.normal.map(|part| part as f64), &corners, &mut self.triangles);
        true
    }
}

/// Returns the colours of a region's vertices. Each is interpolated in the triangle of the face
/// that contains it.
pub(super) fn colours(face: &Face<'_>, plane: &ExactPlane, part: &ExactFace) -> Vec<[u8; 3]> {
    if face.colours.is_empty() {
        return Vec::new();
    }
    let triangles = FaceTriangle::of_face(face.points, face.ring_ends, &mut Triangulator::new());
    part.corners.iter().map(|corner| colour(plane, face, &triangles, corner.point.near)).collect()
}

/// Returns the colour of a face at a point.
fn colour(plane: &ExactPlane, face: &Face<'_>, triangles: &[FaceTriangle], at: [f64; 3]) -> [u8; 3] {
    let axis = plane.main_axis();
    let [u, v] = others(axis);
    // Barycentric weights: signed areas of the triangles of the point and an edge, as seen along
    // the axis.
    let weights = |triangle: &FaceTriangle| {
        let to = triangle.corners.map(|corner| [f64::from(corner[u]) - at[u], f64::from(corner[v]) - at[v]]);
        [0, 1, 2].map(|i| {
            let (a, b) = (to[(i + 1) % 3], to[(i + 2) % 3]);
            a[0] * b[1] - a[1] * b[0]
        })
    };
    // The triangle that contains the point has the maximum of the minimum weights.
    let least = |triangle: &FaceTriangle| {
        let weights = weights(triangle);
        let sum: f64 = weights.iter().sum();
        weights.iter().map(|weight| weight / sum).fold(f64::INFINITY, f64::min)
    };
    let Some(triangle) = triangles.iter().max_by(|a, b| least(a).total_cmp(&least(b))) else {
        return face.colours[0];
    };
    let sum: f64 = weights(triangle).iter().sum();
    let shares = weights(triangle).map(|weight| (weight / sum).max(0.0));
    let whole: f64 = shares.iter().sum();
    let colours = triangle.corners.map(|corner| {
        let vertex = face.points.iter().position(|point| *point == corner).unwrap_or(0);
        face.colours[vertex].map(f64::from)
    });
    [0, 1, 2].map(|channel| {
        let mean = (0..3).map(|corner| shares[corner] * colours[corner][channel]).sum::<f64>() / whole;
        mean.round() as u8
    })
}

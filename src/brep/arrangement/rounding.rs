//! Regions of faces as faces with corners on the grid.

use super::overlay::Region;
use super::point::{ExactPlane, ExactPoint, others};
use crate::Result;
use crate::brep::Face;
use crate::brep::piece::Piece;
use crate::geometry::Triangulator;

/// Moves the corners of regions to the nearest points of the grid; keeps its buffers from region to region.
#[derive(Default)]
pub(super) struct Rounder {
    /// The furthest that a corner was moved, in steps of the grid.
    pub(super) displacement: f64,
    triangulator: Triangulator,
    points: Vec<[i32; 3]>,
    exact: Vec<ExactPoint>,
    ring_ends: Vec<usize>,
    triangles: Vec<[u32; 3]>,
}

impl Rounder {
    /// Hands out a region of a face: as a polygon if its corners lie in the face's plane on the grid, too, and otherwise
    /// in triangles. These are found before corners are moved: slivers then fall together, and do not fold over.
    pub(super) fn round(
        &mut self,
        plane: &ExactPlane,
        face: &Face<'_>,
        region: &Region,
        turned: bool,
        each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
    ) -> Result<()> {
        self.exact.clear();
        self.ring_ends.clear();
        // Rings turn as seen from the axis' positive end.
        let is_up = plane.normal[plane.main_axis()] > 0;
        for ring in &region.rings {
            let start = self.exact.len();
            self.exact.extend_from_slice(ring);
            if turned == is_up {
                self.exact[start..].reverse();
            }
            self.ring_ends.push(self.exact.len());
        }
        self.points.clear();
        for point in &self.exact {
            let rounded = point.rounded();
            let moved: f64 = (0..3).map(|axis| (point.near[axis] - f64::from(rounded[axis])).powi(2)).sum();
            self.displacement = self.displacement.max(moved.sqrt());
            self.points.push(rounded);
        }
        let colours = self.colours(plane, face);
        let stays_flat = self.points.iter().all(|point| plane.height(*point) == 0);
        if stays_flat || !self.triangulate() {
            let Rounder { points, ring_ends, .. } = self;
            return each(&Face { points, ring_ends, colours: &colours, ..*face });
        }
        for triangle in &self.triangles {
            let points = triangle.map(|corner| self.points[corner as usize]);
            let colours: Vec<[u8; 3]> = match colours.is_empty() {
                true => Vec::new(),
                false => triangle.map(|corner| colours[corner as usize]).to_vec(),
            };
            each(&Face { points: &points, ring_ends: &[3], colours: &colours, ..*face })?;
        }
        Ok(())
    }

    /// Cuts the region into triangles as it is before its corners are moved, on a grid that is finer by as much as the
    /// region is small.
    fn triangulate(&mut self) -> bool {
        let least =
            |axis: usize| self.exact.iter().map(|point| point.near[axis]).fold(f64::INFINITY, f64::min);
        let low = [0, 1, 2].map(least);
        let extent = self.exact.iter().flat_map(|point| (0..3).map(|axis| point.near[axis] - low[axis]));
        let extent = extent.fold(1e-9, f64::max);
        let scale = f64::from(1 << 30) / extent;
        let fine = |point: &ExactPoint| {
            [0, 1, 2].map(|axis| ((point.near[axis] - low[axis]) * scale).round() as i64)
        };
        let fine: Vec<[i64; 3]> = self.exact.iter().map(fine).collect();
        self.triangles.clear();
        self.triangulator.triangulate(&fine, &self.ring_ends, &mut self.triangles)
    }

    /// The colours of the corners, between those of the triangle of the face that each lies in.
    fn colours(&mut self, plane: &ExactPlane, face: &Face<'_>) -> Vec<[u8; 3]> {
        if face.colours.is_empty() {
            return Vec::new();
        }
        let pieces = Piece::of_face(face.points, face.ring_ends, &mut self.triangulator);
        self.exact.iter().map(|point| colour(plane, face, &pieces, point.near)).collect()
    }
}

/// The colour of a place of a face.
fn colour(plane: &ExactPlane, face: &Face<'_>, pieces: &[Piece], at: [f64; 3]) -> [u8; 3] {
    let axis = plane.main_axis();
    let [u, v] = others(axis);
    // Areas of the triangles that the place makes with the edges opposite to the corners, as seen along the axis.
    let weights = |piece: &Piece| {
        let to = piece.corners.map(|corner| [f64::from(corner[u]) - at[u], f64::from(corner[v]) - at[v]]);
        [0, 1, 2].map(|i| {
            let (a, b) = (to[(i + 1) % 3], to[(i + 2) % 3]);
            a[0] * b[1] - a[1] * b[0]
        })
    };
    // The least of them in proportion is greatest in the triangle that has the place.
    let least = |piece: &Piece| {
        let weights = weights(piece);
        let sum: f64 = weights.iter().sum();
        weights.iter().map(|weight| weight / sum).fold(f64::INFINITY, f64::min)
    };
    let Some(piece) = pieces.iter().max_by(|a, b| least(a).total_cmp(&least(b))) else {
        return face.colours[0];
    };
    let sum: f64 = weights(piece).iter().sum();
    let shares = weights(piece).map(|weight| (weight / sum).max(0.0));
    let whole: f64 = shares.iter().sum();
    let colours = piece.corners.map(|corner| {
        let place = face.points.iter().position(|point| *point == corner).unwrap_or(0);
        face.colours[place].map(f64::from)
    });
    [0, 1, 2].map(|channel| {
        let mean = (0..3).map(|corner| shares[corner] * colours[corner][channel]).sum::<f64>() / whole;
        mean.round() as u8
    })
}

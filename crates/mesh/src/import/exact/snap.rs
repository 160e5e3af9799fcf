//! Snapping of faces to the grid.

use std::path::Path;

use spinney_base::space::Up;
use spinney_base::{Error, Result};
use spinney_brep::planar::PlanarFaces;
use spinney_brep::{Face, Grid};

/// Snaps faces to the grid. Buffers are reused from face to face.
pub(super) struct Snapper {
    pub(super) grid: Grid,
    pub(super) up: Up,
    pub(super) planar: PlanarFaces,
    /// Number of faces that were read.
    pub(super) read: u64,
    /// Squared maximum distance that a vertex was moved.
    pub(super) squared_displacement: f64,
}

impl Snapper {
    pub(super) fn new(grid: Grid, up: Up) -> Snapper {
        Snapper { grid, up, planar: PlanarFaces::default(), read: 0, squared_displacement: 0.0 }
    }

    /// Passes the snapped face to `each`: one face, several triangles, or nothing.
    pub(super) fn face(
        &mut self,
        path: &Path,
        face: &super::super::MeshFace<'_>,
        part: u32,
        each: &mut dyn FnMut(&Face<'_>) -> Result<()>,
    ) -> Result<()> {
        let source = self.read;
        self.read += 1;
        self.move_corners(path, face)?;
        self.planar.finish(part, source, each)
    }

    /// Snaps the vertices to the grid.
    fn move_corners(&mut self, path: &Path, face: &super::super::MeshFace<'_>) -> Result<()> {
        let Snapper { grid, up, planar, squared_displacement, .. } = self;
        planar.begin(face.ring_ends, face.colours, &mut |corner| {
            let point = up.to_z_up(face.points[corner]);
            let snapped = grid.snap(point).ok_or_else(|| {
                let [x, y, z] = point;
                let expected = "the vertices of the first pass; the file has changed";
                Error::corrupt(path, "vertices", format!("a vertex at {x}, {y}, {z}"), expected)
            })?;
            let there = grid.to_world(snapped);
            let moved = (0..3).map(|axis| (there[axis] - point[axis]).powi(2)).sum::<f64>();
            *squared_displacement = squared_displacement.max(moved);
            Ok(snapped)
        })
    }
}

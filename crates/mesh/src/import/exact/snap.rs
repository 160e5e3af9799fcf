//! Faces moved to the grid.

use std::path::Path;

use spinney_base::space::Up;
use spinney_base::{Error, Result};
use spinney_brep::planar::PlanarFaces;
use spinney_brep::{Face, Grid};

/// Moves faces to the grid; keeps its buffers from face to face.
pub(super) struct Snapper {
    pub(super) grid: Grid,
    pub(super) up: Up,
    pub(super) planar: PlanarFaces,
    /// Faces that were read.
    pub(super) read: u64,
    /// The square of the furthest that a corner was moved.
    pub(super) squared_displacement: f64,
}

impl Snapper {
    pub(super) fn new(grid: Grid, up: Up) -> Snapper {
        Snapper { grid, up, planar: PlanarFaces::default(), read: 0, squared_displacement: 0.0 }
    }

    /// Hands out what becomes of a face of a part of the exact model: itself, some triangles, or nothing.
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

    /// Moves the corners, and leaves out those that have come to lie on the one before, and rings that have fewer than
    /// three then.
    fn move_corners(&mut self, path: &Path, face: &super::super::MeshFace<'_>) -> Result<()> {
        self.planar.begin();
        let mut start = 0;
        for &end in face.ring_ends {
            let ring_start = self.planar.corners();
            for corner in start..end {
                let point = self.up.to_z_up(face.points[corner]);
                let snapped = self.grid.snap(point).ok_or_else(|| {
                    let [x, y, z] = point;
                    let expected = "vertices where they were when the file was read first";
                    Error::corrupt(path, "vertices", format!("a vertex at {x}, {y}, {z}"), expected)
                })?;
                let there = self.grid.to_world(snapped);
                let moved = (0..3).map(|axis| (there[axis] - point[axis]).powi(2)).sum::<f64>();
                self.squared_displacement = self.squared_displacement.max(moved);
                self.planar.add_corner(ring_start, snapped, face.colours.get(corner));
            }
            start = end;
            if !self.planar.end_ring(ring_start) {
                break;
            }
        }
        Ok(())
    }
}

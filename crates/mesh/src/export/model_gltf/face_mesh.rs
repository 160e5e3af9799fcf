//! Triangles of faces near an origin, with numbered vertices.

use std::collections::HashMap;

use glam::DVec3;

use spinney_base::Result;
use spinney_brep::Face;

/// Triangles of part of a model: coordinates of glTF, relative to an origin.
#[derive(Default)]
pub(super) struct FaceMesh {
    /// In the coordinates of the scene or tileset, with z up.
    pub(super) origin: DVec3,
    pub(super) vertices: Vec<FaceVertex>,
    pub(super) triangles: Vec<[u32; 3]>,
    known: HashMap<VertexKey, u32>,
}

/// Identity of a vertex: its grid point, colour, part, and row of values.
type VertexKey = ([i32; 3], [u8; 3], [u32; 2]);

/// A vertex of a mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct FaceVertex {
    /// Relative to the origin, with z up.
    pub(super) at: [f32; 3],
    pub(super) colour: [u8; 3],
    pub(super) part: u32,
    /// Row of the values of its faces.
    pub(super) values: u32,
}

impl FaceMesh {
    pub(super) fn at(origin: DVec3) -> FaceMesh {
        FaceMesh { origin, ..FaceMesh::default() }
    }

    /// Adds a triangle, with the row of its values. `place` returns the position of a grid point in
    /// the coordinates of the scene or tileset. Triangles whose vertices are equal in single
    /// precision are left out.
    ///
    /// # Errors
    /// Those of `place`.
    pub(super) fn push(
        &mut self,
        face: &Face<'_>,
        values: u32,
        place: &dyn Fn([i32; 3]) -> Result<DVec3>,
    ) -> Result<()> {
        let mut corners = [0; 3];
        for (corner, vertex) in corners.iter_mut().enumerate() {
            let colour = face.colours.get(corner).copied().unwrap_or([255; 3]);
            let point = face.points[corner];
            let next = self.vertices.len() as u32;
            let number = *self.known.entry((point, colour, [face.part, values])).or_insert(next);
            if number == next {
                let at = (place(point)? - self.origin).as_vec3().to_array();
                self.vertices.push(FaceVertex { at, colour, part: face.part, values });
            }
            *vertex = number;
        }
        let [a, b, c] = corners.map(|corner| self.vertices[corner as usize].at);
        if a != b && b != c && c != a {
            self.triangles.push(corners);
        }
        Ok(())
    }

    /// Returns the minimum and maximum coordinates relative to the origin; `None` without vertices.
    pub(super) fn bounds(&self) -> Option<[[f32; 3]; 2]> {
        let first = self.vertices.first()?.at;
        Some(self.vertices.iter().fold([first; 2], |[min, max], vertex| {
            [
                [0, 1, 2].map(|axis| min[axis].min(vertex.at[axis])),
                [0, 1, 2].map(|axis| max[axis].max(vertex.at[axis])),
            ]
        }))
    }
}

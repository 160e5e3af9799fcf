//! Triangulated faces of a model.

use super::arrangement::flip_in_plane;
use super::{AttributedFaceVisitor, Face, Faces, Grid};
use crate::exact::normal::ring_normal;
use crate::geometry::Triangulator;
use spinney_base::Result;

/// Faces of a model, triangulated: constrained Delaunay triangulations without new vertices. A face
/// of `c` vertices and `h` holes has `c + 2h - 2` triangles.
pub struct Triangulated<'a> {
    faces: &'a dyn Faces,
    len: u64,
}

impl<'a> Triangulated<'a> {
    /// Counts the triangles of a model's faces. Reads the faces once.
    ///
    /// # Errors
    /// If the faces cannot be read.
    pub fn of(faces: &'a dyn Faces) -> Result<Triangulated<'a>> {
        let mut len = 0;
        each_triangle(faces, &mut |_| {
            len += 1;
            Ok(())
        })?;
        Ok(Triangulated { faces, len })
    }
}

impl Faces for Triangulated<'_> {
    fn grid(&self) -> &Grid {
        self.faces.grid()
    }

    fn parts(&self) -> &[String] {
        self.faces.parts()
    }

    fn origin(&self) -> Option<&dyn Faces> {
        Some(self.faces)
    }

    fn value_columns(&self) -> Result<Vec<String>> {
        self.faces.value_columns()
    }

    fn volume_correction(&self) -> Result<f64> {
        self.faces.volume_correction()
    }

    fn len(&self) -> u64 {
        self.len
    }

    fn each(&self, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
        each_triangle(self.faces, each)
    }

    fn each_with_values(&self, columns: &[&str], each: &mut AttributedFaceVisitor<'_>) -> Result<()> {
        each_triangle_with_values(self.faces, columns, each)
    }
}

/// Visits the triangles of a model's faces, as [`Triangulated`] divides them.
///
/// # Errors
/// If the faces cannot be read, or what `each` returns.
pub fn each_triangle(faces: &dyn Faces, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
    each_triangle_with_values(faces, &[], &mut |face, _| each(face))
}

fn each_triangle_with_values(
    faces: &dyn Faces,
    columns: &[&str],
    each: &mut AttributedFaceVisitor<'_>,
) -> Result<()> {
    let mut triangulator = FaceTriangulator::default();
    let mut number = 0;
    faces.each_with_values(columns, &mut |face, values| {
        for triangle in triangulator.triangles(face) {
            let points = triangle.map(|corner| face.points[corner as usize]);
            let colours =
                triangle.map(|corner| face.colours.get(corner as usize).copied().unwrap_or_default());
            let colours = if face.colours.is_empty() { &[][..] } else { &colours[..] };
            each(&Face { number, points: &points, ring_ends: &[3], colours, ..*face }, values)?;
            number += 1;
        }
        Ok(())
    })
}

/// Divides faces into triangles; the memory is reused for the next face.
#[derive(Default)]
pub(crate) struct FaceTriangulator {
    triangulator: Triangulator,
    wide: Vec<[i64; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl FaceTriangulator {
    /// Returns the triangles of a face, as indices of its points. Their edges are those of the face
    /// and pairs that cancel.
    pub(crate) fn triangles(&mut self, face: &Face<'_>) -> &[[u32; 3]] {
        let FaceTriangulator { triangulator, wide, triangles } = self;
        triangles.clear();
        if face.points.len() == 3 {
            triangles.push([0, 1, 2]);
            return triangles;
        }
        wide.clear();
        wide.extend(face.points.iter().map(|point| point.map(i64::from)));
        if triangulator.triangulate(wide, face.ring_ends, triangles) {
            let normal = ring_normal(&face.points[..face.ring_ends[0]]);
            let points: Vec<[f64; 3]> = face.points.iter().map(|point| point.map(f64::from)).collect();
            flip_in_plane(normal.map(|part| part as f64), &points, triangles);
        } else {
            // Faces without area, or with crossing rings, become fans that keep their edges.
            triangles.clear();
            let mut start = 0;
            for end in face.ring_ends.iter().map(|end| *end as u32) {
                triangles.extend((start + 2..end).map(|corner| [start, corner - 1, corner]));
                start = end;
            }
        }
        triangles
    }
}

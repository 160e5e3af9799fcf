//! Triangulated faces of a model.

use super::arrangement::flip_in_plane;
use super::{AttributedFaceVisitor, Face, Faces, Grid};
use crate::exact::normal::ring_normal;
use crate::geometry::{Triangulator, is_convex};
use spinney_base::Result;

/// Faces of a model, triangulated: constrained Delaunay triangulations without new vertices. A face
/// of `c` vertices and `h` holes has `c + 2h - 2` triangles.
pub struct Triangulated<'a> {
    faces: &'a dyn Faces,
    /// Whether convex faces are kept as they are.
    keeps_convex: bool,
    len: u64,
}

impl<'a> Triangulated<'a> {
    /// Counts the triangles of a model's faces. Reads the faces once.
    ///
    /// # Errors
    /// If the faces cannot be read.
    pub fn of(faces: &'a dyn Faces) -> Result<Triangulated<'a>> {
        Triangulated::new(faces, false)
    }

    /// Does the same for faces that are not convex, or have holes. Others are kept.
    ///
    /// # Errors
    /// If the faces cannot be read.
    pub fn of_concave(faces: &'a dyn Faces) -> Result<Triangulated<'a>> {
        Triangulated::new(faces, true)
    }

    fn new(faces: &'a dyn Faces, keeps_convex: bool) -> Result<Triangulated<'a>> {
        let mut len = 0;
        each_divided(faces, keeps_convex, &[], &mut |_, _| {
            len += 1;
            Ok(())
        })?;
        Ok(Triangulated { faces, keeps_convex, len })
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
        self.each_with_values(&[], &mut |face, _| each(face))
    }

    fn each_with_values(&self, columns: &[&str], each: &mut AttributedFaceVisitor<'_>) -> Result<()> {
        each_divided(self.faces, self.keeps_convex, columns, each)
    }
}

/// Visits the triangles of a model's faces, as [`Triangulated`] divides them.
///
/// # Errors
/// If the faces cannot be read, or what `each` returns.
pub fn each_triangle(faces: &dyn Faces, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
    each_divided(faces, false, &[], &mut |face, _| each(face))
}

/// Visits the triangles of all faces, or of those that are not convex, and the other faces.
fn each_divided(
    faces: &dyn Faces,
    keeps_convex: bool,
    columns: &[&str],
    each: &mut AttributedFaceVisitor<'_>,
) -> Result<()> {
    let mut triangulator = FaceTriangulator::default();
    let mut number = 0;
    faces.each_with_values(columns, &mut |face, values| {
        if keeps_convex && face.ring_ends.len() == 1 && triangulator.is_convex(face) {
            each(&Face { number, ..*face }, values)?;
            number += 1;
            return Ok(());
        }
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
    /// Returns whether the outer ring of a face is convex.
    fn is_convex(&mut self, face: &Face<'_>) -> bool {
        self.wide.clear();
        self.wide.extend(face.points[..face.ring_ends[0]].iter().map(|point| point.map(i64::from)));
        is_convex(&self.wide)
    }

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

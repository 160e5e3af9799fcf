//! Validity of a single face: planar, with an outer ring and holes inside of it that do not cross.

use crate::Face;
use crate::exact::bounds::NORMAL_BITS;
use crate::exact::normal::ring_normal;
use crate::geometry::Triangulator;

/// Checks faces one by one, and keeps its buffers between faces.
pub(crate) struct FaceCheck {
    /// Bits of the grid's coordinates.
    bits: u8,
    triangulator: Triangulator,
    wide: Vec<[i64; 3]>,
    triangles: Vec<[u32; 3]>,
}

/// A description of a face's flaw.
#[derive(Debug)]
pub(crate) struct FaceFlaw {
    pub(crate) found: String,
    pub(crate) expected: &'static str,
}

impl FaceCheck {
    pub(crate) fn new(bits: u8) -> FaceCheck {
        FaceCheck { bits, triangulator: Triangulator::new(), wide: Vec::new(), triangles: Vec::new() }
    }

    /// Checks a face, and returns whether it has an area. A face without area bounds nothing, and
    /// may have any shape.
    pub(crate) fn has_area(&mut self, face: &Face<'_>) -> Result<bool, FaceFlaw> {
        let wrong = |found: String, expected: &'static str| Err(FaceFlaw { found, expected });
        let outside = |at: &[i32; 3]| at.iter().any(|at| (*at as u32) >> self.bits != 0);
        if let Some(at) = face.points.iter().find(|at| outside(at)) {
            return wrong(format!("a vertex at {at:?}"), "vertices on the grid");
        }
        let mut start = 0;
        for &end in face.ring_ends {
            if end < start + 3 || end > face.points.len() {
                let found = format!("rings that end at {:?}", face.ring_ends);
                return wrong(found, "rings of at least three vertices");
            }
            start = end;
        }
        if start != face.points.len() || start == 0 {
            return wrong(format!("rings up to vertex {start}"), "rings of all vertices");
        }
        let normal = ring_normal(&face.points[..face.ring_ends[0]]);
        if normal == [0; 3] || face.points.len() == 3 {
            return Ok(normal != [0; 3]);
        }
        // (Predicates on planes need normals within this many bits.)
        if normal.iter().any(|part| part.unsigned_abs() >> NORMAL_BITS != 0) {
            return wrong("a ring of more than eight turns".into(), "rings that do not cross");
        }
        let first = face.points[0];
        let is_off = |at: &[i32; 3]| {
            (0..3).map(|axis| i128::from(normal[axis]) * i128::from(at[axis] - first[axis])).sum::<i128>()
                != 0
        };
        if let Some(at) = face.points.iter().find(|at| is_off(at)) {
            return wrong(format!("a vertex at {at:?}"), "all vertices in one plane");
        }
        self.wide.clear();
        self.wide.extend(face.points.iter().map(|point| point.map(i64::from)));
        self.triangles.clear();
        match self.triangulator.triangulate(&self.wide, face.ring_ends, &mut self.triangles) {
            true => Ok(true),
            false => wrong("rings that cross".into(), "an outer ring, and holes inside it"),
        }
    }
}

//! Common points of two faces.

use super::point::ExactPoint;

/// Common points of two faces.
pub(crate) struct Contact {
    pub(crate) faces: [u32; 2],
    pub(crate) segments: Vec<[ExactPoint; 2]>,
    pub(crate) points: Vec<ExactPoint>,
    /// Whether the faces are coplanar and may overlap. If both have all vertices on the grid, they
    /// do. With an exact face, only the boxes are known to touch: an overlay of both decides.
    pub(crate) may_overlap: bool,
}

impl Contact {
    /// Returns the contact of a face and its copy.
    pub(super) fn of_copy(faces: [u32; 2]) -> Contact {
        Contact { faces, segments: Vec::new(), points: Vec::new(), may_overlap: true }
    }
}

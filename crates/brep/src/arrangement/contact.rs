//! Common points of two faces.

use super::point::ExactPoint;

/// Common points of two faces.
pub(crate) struct Contact {
    pub(crate) faces: [u32; 2],
    pub(crate) segments: Vec<[ExactPoint; 2]>,
    pub(crate) points: Vec<ExactPoint>,
    /// Whether the faces are coplanar and overlap.
    pub(crate) in_plane: bool,
}

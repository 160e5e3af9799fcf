//! Common points of two faces.

use super::point::ExactPoint;

/// Common points of two faces.
pub(crate) struct Contact {
    pub faces: [u32; 2],
    pub segments: Vec<[ExactPoint; 2]>,
    pub points: Vec<ExactPoint>,
    /// Whether the faces lie in one plane, and on each other.
    pub in_plane: bool,
}

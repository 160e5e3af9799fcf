//! Exact planes of faces.

use crate::Face;
use crate::exact::normal::ring_normal;

/// The plane of a face: exact, since faces are planar on the grid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    /// Outward.
    pub(super) normal: [i64; 3],
    /// A point of the plane.
    pub(super) through: [i32; 3],
}

impl Plane {
    pub(super) fn of(face: &Face<'_>) -> Plane {
        let outer = face.rings().next().unwrap_or_default();
        Plane { normal: ring_normal(outer), through: outer.first().copied().unwrap_or_default() }
    }
}

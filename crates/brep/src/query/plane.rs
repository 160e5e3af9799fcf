//! Planes of faces and the sides of points, exact.

use crate::Face;
use crate::geometry::crossing::ring_normal;

/// The plane of a face: exact, since faces are planar on the grid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    /// Outward.
    pub(super) normal: [i64; 3],
    /// A point of it.
    pub(super) through: [i32; 3],
}

impl Plane {
    pub(super) fn of(face: &Face<'_>) -> Plane {
        let outer = face.rings().next().unwrap_or_default();
        Plane { normal: ring_normal(outer), through: outer.first().copied().unwrap_or_default() }
    }
}

#[inline]
pub(super) fn cross(u: [i64; 3], v: [i64; 3]) -> [i64; 3] {
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

/// The sign of a number, and that of the first component of a vector that is not zero where it is zero: the number's
/// sign after a step along the vector's axes that is by far longest along x and by far shortest along z.
#[inline]
pub(super) fn sign_or_first<T: Copy + PartialOrd + Default>(number: T, vector: [T; 3]) -> i32 {
    let zero = T::default();
    for number in [number, vector[0], vector[1], vector[2]] {
        if number != zero {
            return if number > zero { 1 } else { -1 };
        }
    }
    0
}

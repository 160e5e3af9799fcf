//! Three-component vectors of any number type: integers of any width, doubles, and numbers with an
//! error bound.
//!
//! The caller widens the numbers first, as far as their products need it: see
//! [`bounds`](super::bounds).

use std::ops::{Add, Mul, Sub};

/// Returns the vector from the second point to the first.
#[inline]
pub fn subtract<T: Copy + Sub<Output = T>>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Returns the dot product.
#[inline]
pub fn dot<T: Copy + Add<Output = T> + Mul<Output = T>>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns the cross product: perpendicular to both, on the side from which the turn from the first
/// to the second is counterclockwise.
#[inline]
pub fn cross<T: Copy + Sub<Output = T> + Mul<Output = T>>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns the two other axes, in the order that makes a right-handed system with the first.
#[inline]
pub(crate) const fn others(axis: usize) -> [usize; 2] {
    [(axis + 1) % 3, (axis + 2) % 3]
}

/// Returns the two other axes, the smaller first, along which the perturbation is larger (see
/// `perturbation.rs`).
#[inline]
pub const fn ascending_others(axis: usize) -> [usize; 2] {
    match axis {
        0 => [1, 2],
        1 => [0, 2],
        _ => [0, 1],
    }
}

/// Returns the axis along which an integer vector is longest, the last one of several. A plane with
/// this normal has its largest projection along it.
#[inline]
pub(crate) fn main_axis<T: Copy + Into<i128>>(vector: [T; 3]) -> usize {
    let length = |axis: &usize| -> u128 { vector[*axis].into().unsigned_abs() };
    (0..3).max_by_key(length).unwrap_or(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_of_a_right_handed_system() {
        let axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
        for axis in 0..3 {
            let [u, v] = others(axis);
            assert_eq!(cross(axes[u], axes[v]), axes[axis]);
            let [low, high] = ascending_others(axis);
            assert!(low < high && (low, high) == (u.min(v), u.max(v)));
        }
        let (a, b) = ([2i64, -3, 5], [7, 1, -4]);
        let across = cross(a, b);
        assert_eq!((dot(a, across), dot(b, across)), (0, 0));
        assert_eq!(dot(across, across), dot(a, a) * dot(b, b) - dot(a, b).pow(2));
        assert_eq!(subtract(a, b), [-5, -4, 9]);
        assert_eq!(
            [main_axis([1i64, -9, 9]), main_axis([0i128; 3]), main_axis([i64::MIN, 0, i64::MAX])],
            [2, 2, 0]
        );
    }
}

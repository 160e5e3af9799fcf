//! Tie-breaking, consistent over all faces.
//!
//! Whether a point is inside a solid depends on the faces between it and a point whose state is
//! known. The path between the points may pass through edges and vertices, and either point may be
//! on a face. For results that are consistent over all faces, every query point is treated as moved
//! by an infinitesimal vector, whose x is much larger than its y, and its y much larger than its z
//! (simulation of simplicity, Edelsbrunner and Muecke, 1990). The first derivative that is not zero
//! then decides a tie, and every line meets a closed surface like a line in general position. So
//! the results for points, axis-parallel lines and other lines are consistent with each other.

/// Returns the sign of a linear function at a perturbed point: that of its value at the point
/// itself or, if the value is zero, of the first gradient component that is not zero. 0 if all are
/// zero.
///
/// Components are in the order of the axes; axes that the function does not depend on may be
/// omitted.
#[inline]
pub(crate) fn sign_or_first<T: Copy + PartialOrd + Default, const N: usize>(
    value: T,
    gradient: [T; N],
) -> i32 {
    let zero = T::default();
    for number in std::iter::once(value).chain(gradient) {
        if number != zero {
            return if number > zero { 1 } else { -1 };
        }
    }
    0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step that is small enough, and much smaller along each axis than along the previous one,
    /// gives the same sign.
    #[test]
    fn signs_are_those_after_a_small_step() {
        for n in 0..5 * 5 * 5 * 5 {
            let [value, x, y, z] = [n % 5 - 2, n / 5 % 5 - 2, n / 25 % 5 - 2, n / 125 - 2];
            let moved: i64 = value * 1_000_000 + x * 10_000 + y * 100 + z;
            assert_eq!(sign_or_first(value, [x, y, z]), moved.signum() as i32, "{value} {x} {y} {z}");
        }
    }
}

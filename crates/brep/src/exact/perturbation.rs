//! Ties, decided for all faces together.
//!
//! Whether a point is inside a solid is told by the faces between it and a point of which that is known. The way from
//! the one to the other may pass through edges and vertices, and either point may lie on a face; to have an answer that
//! is right for all faces together, every point that is asked about is thought of as moved by an infinitesimal vector,
//! by far the most along x and by far the least along z (the simulation of simplicity of Edelsbrunner and Muecke,
//! 1990). A tie is then decided by the first derivative that is not zero, and every line meets a closed surface as one
//! in general position does. Whoever asks in this way, of a point, a line along an axis or any other line, gets answers
//! that fit together.

/// The sign of a linear function at a point moved a little: that of its value there, or of the first component of its
/// gradient that is not zero where the value is zero. 0 if all are.
///
/// Components stand in the order of the axes; those of axes that the function does not know may be left out.
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

    /// A step that is small enough, and much smaller along each axis than along the one before, has the same sign.
    #[test]
    fn signs_are_those_after_a_small_step() {
        for n in 0..5 * 5 * 5 * 5 {
            let [value, x, y, z] = [n % 5 - 2, n / 5 % 5 - 2, n / 25 % 5 - 2, n / 125 - 2];
            let moved: i64 = value * 1_000_000 + x * 10_000 + y * 100 + z;
            assert_eq!(sign_or_first(value, [x, y, z]), moved.signum() as i32, "{value} {x} {y} {z}");
        }
    }
}

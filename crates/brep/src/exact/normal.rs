//! Normals of rings by Newell's method, in integers.

use super::vector::{cross, others, subtract};

/// Returns twice the area that a closed ring encloses in each projection along an axis, seen from
/// that axis' positive end. This is the normal of its plane, or the mean direction of a ring that
/// is not planar. Zero for fewer than three points.
///
/// Coordinates differ by at most 2^32, and there are at most 2^32 points.
pub(crate) fn newell<T: Copy + Into<i64>>(ring: &[[T; 3]]) -> [i128; 3] {
    let Some(first) = ring.first() else { return [0; 3] };
    let from_first = |point: &[T; 3]| subtract(point.map(T::into), first.map(T::into));
    // The two edges at the first vertex, the origin here, contribute nothing and are skipped.
    let mut normal = [0i128; 3];
    for corners in ring.windows(2) {
        let (a, b) = (from_first(&corners[0]), from_first(&corners[1]));
        for (axis, part) in normal.iter_mut().enumerate() {
            let [j, k] = others(axis);
            *part += i128::from(a[j]) * i128::from(b[k]) - i128::from(a[k]) * i128::from(b[j]);
        }
    }
    normal
}

/// Returns the normal of a triangle; its length is twice the area. Coordinate differences must fit
/// into 31 bits.
#[inline]
pub fn triangle_normal([a, b, c]: &[[i32; 3]; 3]) -> [i64; 3] {
    let [u, v] = [b, c].map(|end| subtract(end.map(i64::from), a.map(i64::from)));
    cross(u, v)
}

/// Returns the normal of a ring with coordinates of at most [`MAX_BITS`](super::bounds::MAX_BITS),
/// by Newell's method; its length is twice the area.
///
/// The normal of a ring with many vertices may exceed 62 bits. It is then halved until it fits,
/// which does not happen to planar rings with less than 2^8 turns.
pub(crate) fn ring_normal(ring: &[[i32; 3]]) -> [i64; 3] {
    if let [a, b, c] = *ring {
        return triangle_normal(&[a, b, c]);
    }
    let mut normal = newell(ring);
    while normal.iter().any(|part| part.unsigned_abs() >> 62 != 0) {
        normal = normal.map(|part| part / 2);
    }
    normal.map(|part| part as i64)
}

#[cfg(test)]
mod tests {
    use super::super::bounds::{MAX_BITS, NORMAL_BITS};
    use super::*;

    /// The largest rings have normals of at most the planned number of bits.
    #[test]
    fn the_largest_normals_have_the_bits_that_are_planned_for() {
        let far = (1 << MAX_BITS) - 1;
        let square = [[0, 0, 0], [far, 0, far], [far, far, far], [0, far, 0]];
        let area = i64::from(far).pow(2);
        assert_eq!(ring_normal(&square), [-2 * area, 0, 2 * area]);
        assert!(2 * area < 1 << (2 * MAX_BITS + 1) && 2 * area >= 1 << (2 * MAX_BITS));
        assert_eq!(ring_normal(&square[..3]), [-area, 0, area]);
        // Eight times around a square.
        let turns = square.repeat(8);
        assert_eq!(ring_normal(&turns), [-16 * area, 0, 16 * area]);
        assert!(16 * area < 1 << NORMAL_BITS);
        // So many turns that the normal is halved.
        let turns = ring_normal(&square.repeat(1 << 11));
        assert!(turns[2] > 1 << 61 && turns[0] == -turns[2] && turns[1] == 0);
        assert_eq!((ring_normal(&[]), ring_normal(&square[..2])), ([0; 3], [0; 3]));
    }
}

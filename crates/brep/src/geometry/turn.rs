//! Orientation of three points in the plane.

/// Returns twice the signed area of the triangle of three points; positive if counterclockwise.
pub(super) fn turn(a: [i64; 2], b: [i64; 2], c: [i64; 2]) -> i128 {
    let wide = |x: i64| i128::from(x);
    wide(b[0] - a[0]) * wide(c[1] - a[1]) - wide(b[1] - a[1]) * wide(c[0] - a[0])
}

//! Predicates and distances of line segments, points and boxes, in two or three axes (then z is 0).
//! Predicates are exact, in integers; touching counts as meeting.
//!
//! Vertices are grid points; query positions are fixed point, in units of 2^-16 of a grid unit.
//! Differences are below 2^54 such units, so products of two in predicates are below 2^110.

#[cfg(test)]
mod tests;

use crate::grid::LineAxes;

/// Fixed-point units per grid unit.
pub(crate) const FRACTION: i64 = 1 << 16;

/// Fixed-point position.
pub(crate) type FixedPosition = [i64; 3];

/// Two vertices on the grid.
pub(crate) type Segment = [[i32; 3]; 2];

/// Pairs of axes that span the coordinate planes. The first is the plane of x and y, with all there
/// is of two axes.
const PLANES: [[usize; 2]; 3] = [[0, 1], [0, 2], [1, 2]];

/// Planes in which predicates must hold: that of x and y if all positions have one z.
#[inline]
fn planes(positions: [FixedPosition; 4]) -> &'static [[usize; 2]] {
    let [a, b, c, d] = positions.map(|position| position[2]);
    if a == b && b == c && c == d { &PLANES[..1] } else { &PLANES }
}

/// Ends of a segment in fixed point.
#[inline]
pub(crate) fn ends([a, b]: Segment) -> [FixedPosition; 2] {
    [a, b].map(|end| end.map(|step| i64::from(step) * FRACTION))
}

/// Minimum and maximum corner of a segment's bounding box.
#[inline]
pub(crate) fn bounds_of([a, b]: Segment) -> [[i32; 3]; 2] {
    [std::array::from_fn(|axis| a[axis].min(b[axis])), std::array::from_fn(|axis| a[axis].max(b[axis]))]
}

/// Orientation of a point in the plane of two axes: positive if it is left of the line from `a` to
/// `b`, negative if right, 0 if on it.
#[inline]
fn side([u, v]: [usize; 2], [a, b]: [FixedPosition; 2], position: FixedPosition) -> i128 {
    let along = [i128::from(b[u] - a[u]), i128::from(b[v] - a[v])];
    let to = [i128::from(position[u] - a[u]), i128::from(position[v] - a[v])];
    along[0] * to[1] - along[1] * to[0]
}

#[inline]
fn difference(from: FixedPosition, to: FixedPosition) -> [i128; 3] {
    std::array::from_fn(|axis| i128::from(to[axis]) - i128::from(from[axis]))
}

#[inline]
fn dot(p: [i128; 3], q: [i128; 3]) -> i128 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}

#[inline]
fn cross(p: [i128; 3], q: [i128; 3]) -> [i128; 3] {
    let z = p[0] * q[1] - p[1] * q[0];
    if p[2] == 0 && q[2] == 0 {
        return [0, 0, z];
    }
    [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], z]
}

/// Product of vectors whose components are integers too large to multiply exactly, rounded.
#[inline]
fn rounded_dot(p: [i128; 3], q: [i128; 3]) -> f64 {
    (0..3).map(|axis| p[axis] as f64 * q[axis] as f64).sum()
}

/// Whether two boxes, each given by its minimum and maximum corner, intersect.
#[inline]
pub(crate) fn boxes_meet([low, high]: [FixedPosition; 2], [lower, higher]: [FixedPosition; 2]) -> bool {
    (0..3).all(|axis| low[axis] <= higher[axis] && lower[axis] <= high[axis])
}

/// Converts a box from grid units to fixed point.
#[inline]
pub(crate) fn fixed_box(bounds: [[i32; 3]; 2]) -> [FixedPosition; 2] {
    bounds.map(|corner| corner.map(|step| i64::from(step) * FRACTION))
}

/// Bounding box of two points.
pub(crate) fn box_of([a, b]: [FixedPosition; 2]) -> [FixedPosition; 2] {
    [std::array::from_fn(|axis| a[axis].min(b[axis])), std::array::from_fn(|axis| a[axis].max(b[axis]))]
}

/// Box of positions that is extended by a distance along all axes.
#[inline]
pub(crate) fn extended([low, high]: [FixedPosition; 2], by: f64) -> [FixedPosition; 2] {
    // All positions are within 2^52; differences must not overflow.
    let by = by.ceil().min((1u64 << 54) as f64) as i64;
    [low.map(|number| number - by), high.map(|number| number + by)]
}

/// Whether a line segment intersects a box, including its border. Tests the separating axes: the
/// coordinate axes, and the products of each with the segment's direction. The latter are normals
/// of the segment in the coordinate planes.
pub(crate) fn meets_box(line: [FixedPosition; 2], [low, high]: [FixedPosition; 2]) -> bool {
    if !boxes_meet(box_of(line), [low, high]) {
        return false;
    }
    planes([line[0], line[1], low, high]).iter().all(|[u, v]| {
        let corners = [[low[*u], low[*v]], [high[*u], low[*v]], [high[*u], high[*v]], [low[*u], high[*v]]];
        let sides = corners.map(|corner| {
            let mut position = [0; 3];
            (position[*u], position[*v]) = (corner[0], corner[1]);
            side([*u, *v], line, position).signum()
        });
        !(sides == [1; 4] || sides == [-1; 4])
    })
}

/// Whether two line segments intersect, including their ends: they lie in a plane, and intersect in
/// the projections to all coordinate planes.
///
/// If they are not parallel, one of the projections maps their common plane one to one. If they
/// are, and meet in all projections, they lie on one line, and intersect exactly if their bounding
/// boxes do.
pub(crate) fn meet(one: [FixedPosition; 2], other: [FixedPosition; 2]) -> bool {
    if !boxes_meet(box_of(one), box_of(other)) {
        return false;
    }
    let meet_in = |plane: [usize; 2]| {
        // If the segments are collinear, they intersect exactly if their bounding boxes do.
        let parts = |line: [FixedPosition; 2], ends: [FixedPosition; 2]| {
            let [a, b] = ends.map(|end| side(plane, line, end).signum());
            a * b > 0
        };
        !parts(one, other) && !parts(other, one)
    };
    let planes = planes([one[0], one[1], other[0], other[1]]);
    planes.iter().all(|plane| meet_in(*plane)) && (planes.len() == 1 || are_in_a_plane(one, other))
}

/// Whether the volume that two segments span is zero.
fn are_in_a_plane([a, b]: [FixedPosition; 2], [c, d]: [FixedPosition; 2]) -> bool {
    let normal = cross(difference(a, b), difference(c, d));
    let between = difference(a, c);
    // The volume is below 2^166, its rounded value differs from it by less than 2^116. If that is
    // below 2^127, the volume is zero exactly if its lowest 128 bits are.
    let low = (0..3).fold(0i128, |sum, axis| sum.wrapping_add(normal[axis].wrapping_mul(between[axis])));
    low == 0 && rounded_dot(normal, between).abs() < 2f64.powi(127)
}

/// Intersection point of two segments that meet, in fixed point. For collinear segments, the first
/// point of the overlap along `one`.
pub(crate) fn meeting(one: [FixedPosition; 2], other: [FixedPosition; 2]) -> [f64; 3] {
    let [a, b] = one;
    // Positions of the ends of `one` relative to `other`, in the plane where they differ most.
    let sides = PLANES.map(|plane| (side(plane, other, a), side(plane, other, b)));
    let (from, to) = sides.into_iter().max_by_key(|(from, to)| from.abs_diff(*to)).unwrap_or_default();
    if from != to {
        let share = from as f64 / (from - to) as f64;
        return std::array::from_fn(|axis| a[axis] as f64 + share * (b[axis] - a[axis]) as f64);
    }
    let along = |position: &FixedPosition| dot(difference(a, *position), difference(a, b));
    let is_inside = |position: &FixedPosition| {
        let [low, high] = box_of(other);
        (0..3).all(|axis| (low[axis]..=high[axis]).contains(&position[axis]))
    };
    let first = if is_inside(&a) { a } else { other.into_iter().min_by_key(along).unwrap_or(a) };
    first.map(|number| number as f64)
}

/// Squared distance of two line segments that do not meet, in fixed point, and the point of `one`
/// that is nearest to `other`. The result is rounded.
pub(crate) fn between(one: [FixedPosition; 2], other: [FixedPosition; 2]) -> (f64, [f64; 3]) {
    let ([a, b], [c, d]) = (one, other);
    let (along, across, gap) = (difference(a, b), difference(c, d), difference(a, c));
    let normal = cross(along, across);
    let square = rounded_dot(normal, normal);
    // Nearest points inside of both segments lie on their common normal.
    let inside = (square > 0.0)
        .then(|| [across, along].map(|other| rounded_dot(cross(gap, other), normal) / square))
        .filter(|shares| shares.iter().all(|share| *share > 0.0 && *share < 1.0));
    if let Some([share, _]) = inside {
        let volume = rounded_dot(normal, gap);
        let position = std::array::from_fn(|axis| a[axis] as f64 + share * along[axis] as f64);
        return (volume * volume / square, position);
    }
    // Otherwise one of them is an end.
    let exact = |end: FixedPosition| end.map(|number| number as f64);
    let ends = [
        (square_distance(other, a), exact(a)),
        (square_distance(other, b), exact(b)),
        (square_distance(one, c), nearest_point(one, c, LineAxes::Space)),
        (square_distance(one, d), nearest_point(one, d, LineAxes::Space)),
    ];
    ends.into_iter().min_by(|p, q| p.0.total_cmp(&q.0)).unwrap_or((f64::INFINITY, exact(a)))
}

/// Squared distance of a point from a line segment, in fixed point.
///
/// Whether an end is nearest is decided exactly. If so, the result is the squared distance from
/// that end, rounded once, so segments that share a nearest vertex have equal distances. Otherwise
/// the result is rounded a few times, independently of the segment's direction.
pub(crate) fn square_distance([a, b]: [FixedPosition; 2], from: FixedPosition) -> f64 {
    let along = difference(a, b);
    let (to_a, to_b) = (difference(a, from), difference(b, from));
    if dot(along, to_a) <= 0 {
        return dot(to_a, to_a) as f64;
    }
    if dot(along, to_b) >= 0 {
        return dot(to_b, to_b) as f64;
    }
    let across = cross(along, to_a);
    rounded_dot(across, across) / dot(along, along) as f64
}

/// Point of a line segment that is nearest to another point, by distances along these axes.
pub(crate) fn nearest_point([a, b]: [FixedPosition; 2], from: FixedPosition, axes: LineAxes) -> [f64; 3] {
    let along: [f64; 3] = std::array::from_fn(|axis| (b[axis] - a[axis]) as f64);
    let to: [f64; 3] = std::array::from_fn(|axis| (from[axis] - a[axis]) as f64);
    let count = if axes == LineAxes::Plane { 2 } else { 3 };
    let product = |q: [f64; 3]| (0..count).map(|axis| along[axis] * q[axis]).sum::<f64>();
    let share = (product(to) / product(along)).clamp(0.0, 1.0);
    let share = if share.is_nan() { 0.0 } else { share };
    std::array::from_fn(|axis| a[axis] as f64 + share * along[axis])
}

/// Lower bound for the squared distance of a point from a box, in fixed point. It is slightly
/// reduced, since distances from segments are rounded and a box must not be skipped because of
/// that.
#[inline]
pub(crate) fn square_to_box([low, high]: [FixedPosition; 2], from: FixedPosition) -> f64 {
    // Differences are exact as doubles. The result here is rounded five times, the distance from a
    // segment nine times, by a relative error of 2^-53 each.
    const LESS: f64 = 1.0 - 1.0 / (1u64 << 49) as f64;
    let along = |axis: usize| (low[axis] - from[axis]).max(from[axis] - high[axis]).max(0) as f64;
    (along(0) * along(0) + along(1) * along(1) + along(2) * along(2)) * LESS
}

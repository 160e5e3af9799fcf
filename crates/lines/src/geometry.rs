//! Predicates and distances of line segments, points and boxes. Predicates are exact, in integers;
//! touching counts as meeting.
//!
//! Vertices are grid points; query positions are fixed point, in units of 2^-16 of a grid unit.
//! Differences are below 2^54 such units, so products in predicates are below 2^110.

/// Fixed-point units per grid unit.
pub(crate) const FRACTION: i64 = 1 << 16;

/// Fixed-point position.
pub(crate) type FixedPosition = [i64; 2];

/// Two vertices on the grid.
pub(crate) type Segment = [[i32; 2]; 2];

/// Ends of a segment in fixed point.
#[inline]
pub(crate) fn ends([a, b]: Segment) -> [FixedPosition; 2] {
    [a, b].map(|end| end.map(|step| i64::from(step) * FRACTION))
}

/// Minimum and maximum corner of a segment's bounding box.
#[inline]
pub(crate) fn bounds_of([a, b]: Segment) -> [[i32; 2]; 2] {
    [std::array::from_fn(|axis| a[axis].min(b[axis])), std::array::from_fn(|axis| a[axis].max(b[axis]))]
}

/// Orientation of a point: positive if it is left of the line from `a` to `b`, negative if right, 0
/// if on it.
#[inline]
fn side([a, b]: [FixedPosition; 2], position: FixedPosition) -> i128 {
    let along = [i128::from(b[0] - a[0]), i128::from(b[1] - a[1])];
    let to = [i128::from(position[0] - a[0]), i128::from(position[1] - a[1])];
    along[0] * to[1] - along[1] * to[0]
}

/// Whether two boxes, each given by its minimum and maximum corner, intersect.
#[inline]
pub(crate) fn boxes_meet([low, high]: [FixedPosition; 2], [lower, higher]: [FixedPosition; 2]) -> bool {
    (0..2).all(|axis| low[axis] <= higher[axis] && lower[axis] <= high[axis])
}

/// Converts a box from grid units to fixed point.
#[inline]
pub(crate) fn fixed_box(bounds: [[i32; 2]; 2]) -> [FixedPosition; 2] {
    bounds.map(|corner| corner.map(|step| i64::from(step) * FRACTION))
}

/// Bounding box of two points.
pub(crate) fn box_of([a, b]: [FixedPosition; 2]) -> [FixedPosition; 2] {
    [std::array::from_fn(|axis| a[axis].min(b[axis])), std::array::from_fn(|axis| a[axis].max(b[axis]))]
}

/// Whether a line segment intersects a box, including its border. Tests the separating axes: both
/// coordinate axes and the segment's normal.
pub(crate) fn meets_box(line: [FixedPosition; 2], [low, high]: [FixedPosition; 2]) -> bool {
    if !boxes_meet(box_of(line), [low, high]) {
        return false;
    }
    let corners = [low, [high[0], low[1]], high, [low[0], high[1]]];
    let sides = corners.map(|corner| side(line, corner).signum());
    !(sides == [1; 4] || sides == [-1; 4])
}

/// Whether two line segments intersect, including their ends.
pub(crate) fn meet(one: [FixedPosition; 2], other: [FixedPosition; 2]) -> bool {
    if !boxes_meet(box_of(one), box_of(other)) {
        return false;
    }
    // If the segments are collinear, they intersect exactly if their bounding boxes do.
    let parts = |line: [FixedPosition; 2], ends: [FixedPosition; 2]| {
        let [a, b] = ends.map(|end| side(line, end).signum());
        a * b > 0
    };
    !parts(one, other) && !parts(other, one)
}

/// Intersection point of two segments that meet, in fixed point. For collinear segments, the first
/// point of the overlap along `one`.
pub(crate) fn meeting(one: [FixedPosition; 2], other: [FixedPosition; 2]) -> [f64; 2] {
    let [a, b] = one;
    let (from, to) = (side(other, a), side(other, b));
    if from != to {
        let share = from as f64 / (from - to) as f64;
        return std::array::from_fn(|axis| a[axis] as f64 + share * (b[axis] - a[axis]) as f64);
    }
    let along = |position: &FixedPosition| {
        (0..2).map(|axis| i128::from(position[axis] - a[axis]) * i128::from(b[axis] - a[axis])).sum::<i128>()
    };
    let is_inside = |position: &FixedPosition| {
        let [low, high] = box_of(other);
        (0..2).all(|axis| (low[axis]..=high[axis]).contains(&position[axis]))
    };
    let first = if is_inside(&a) { a } else { other.into_iter().min_by_key(along).unwrap_or(a) };
    first.map(|number| number as f64)
}

/// Squared distance of a point from a line segment, in fixed point.
///
/// Whether an end is nearest is decided exactly. If so, the result is the squared distance from
/// that end, rounded once, so segments that share a nearest vertex have equal distances. Otherwise
/// the result is rounded four times, independently of the segment's direction.
pub(crate) fn square_distance(line: [FixedPosition; 2], from: FixedPosition) -> f64 {
    let [a, b] = line;
    let difference = |p: FixedPosition, q: FixedPosition| {
        [i128::from(q[0]) - i128::from(p[0]), i128::from(q[1]) - i128::from(p[1])]
    };
    let dot = |p: [i128; 2], q: [i128; 2]| p[0] * q[0] + p[1] * q[1];
    let along = difference(a, b);
    let (to_a, to_b) = (difference(a, from), difference(b, from));
    if dot(along, to_a) <= 0 {
        return dot(to_a, to_a) as f64;
    }
    if dot(along, to_b) >= 0 {
        return dot(to_b, to_b) as f64;
    }
    let across = (along[0] * to_a[1] - along[1] * to_a[0]) as f64;
    across * across / dot(along, along) as f64
}

/// Lower bound for the squared distance of a point from a box, in fixed point. It is slightly
/// reduced, since distances from segments are rounded and a box must not be skipped because of
/// that.
#[inline]
pub(crate) fn square_to_box([low, high]: [FixedPosition; 2], from: FixedPosition) -> f64 {
    // Differences are exact as doubles. The result here is rounded three times, the distance from a
    // segment seven times, by a relative error of 2^-53 each.
    const LESS: f64 = 1.0 - 1.0 / (1u64 << 49) as f64;
    let along = |axis: usize| (low[axis] - from[axis]).max(from[axis] - high[axis]).max(0) as f64;
    (along(0) * along(0) + along(1) * along(1)) * LESS
}

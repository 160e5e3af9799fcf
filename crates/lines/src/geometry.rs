//! Distances of lines from places, and whether they meet boxes and other lines: decided in whole numbers, touching included.
//!
//! Vertices lie on the grid; what is asked about lies on places of 2^-16 of a step. Differences have less than 2^54 of these, so that all products that decide have
//! fewer than 2^110.

/// Parts of a step by which questions are asked.
pub(crate) const FRACTION: i64 = 1 << 16;

/// A place, in parts of a step.
pub(crate) type Place = [i64; 2];

/// Two vertices on the grid.
pub(crate) type Segment = [[i32; 2]; 2];

/// A segment in parts of a step.
#[inline]
pub(crate) fn ends([a, b]: Segment) -> [Place; 2] {
    [a, b].map(|end| end.map(|step| i64::from(step) * FRACTION))
}

/// Least and greatest corner of a segment.
#[inline]
pub(crate) fn bounds_of([a, b]: Segment) -> [[i32; 2]; 2] {
    [std::array::from_fn(|axis| a[axis].min(b[axis])), std::array::from_fn(|axis| a[axis].max(b[axis]))]
}

/// Above 0 if a place is left of the line from `a` to `b`, below if right, 0 if on it.
#[inline]
fn side([a, b]: [Place; 2], place: Place) -> i128 {
    let along = [i128::from(b[0] - a[0]), i128::from(b[1] - a[1])];
    let to = [i128::from(place[0] - a[0]), i128::from(place[1] - a[1])];
    along[0] * to[1] - along[1] * to[0]
}

/// Whether boxes, each with a least and a greatest corner, have a place in common.
#[inline]
pub(crate) fn boxes_meet([low, high]: [Place; 2], [lower, higher]: [Place; 2]) -> bool {
    (0..2).all(|axis| low[axis] <= higher[axis] && lower[axis] <= high[axis])
}

/// Bounds on the grid in parts of a step.
#[inline]
pub(crate) fn fixed_box(bounds: [[i32; 2]; 2]) -> [Place; 2] {
    bounds.map(|corner| corner.map(|step| i64::from(step) * FRACTION))
}

/// The box around two places.
pub(crate) fn box_of([a, b]: [Place; 2]) -> [Place; 2] {
    [std::array::from_fn(|axis| a[axis].min(b[axis])), std::array::from_fn(|axis| a[axis].max(b[axis]))]
}

/// Whether a line between two places has a place in a box, its border included: no axis and no line along it parts the two.
pub(crate) fn meets_box(line: [Place; 2], [low, high]: [Place; 2]) -> bool {
    if !boxes_meet(box_of(line), [low, high]) {
        return false;
    }
    let corners = [low, [high[0], low[1]], high, [low[0], high[1]]];
    let sides = corners.map(|corner| side(line, corner).signum());
    !(sides == [1; 4] || sides == [-1; 4])
}

/// Whether two lines have a place in common, their ends included.
pub(crate) fn meet(one: [Place; 2], other: [Place; 2]) -> bool {
    if !boxes_meet(box_of(one), box_of(other)) {
        return false;
    }
    // (On one line, boxes that meet have a place of both in common.)
    let parts = |line: [Place; 2], ends: [Place; 2]| {
        let [a, b] = ends.map(|end| side(line, end).signum());
        a * b > 0
    };
    !parts(one, other) && !parts(other, one)
}

/// Where two lines that meet do so, in parts of a step: for lines that lie on each other the first place of both along the first one.
pub(crate) fn meeting(one: [Place; 2], other: [Place; 2]) -> [f64; 2] {
    let [a, b] = one;
    let (from, to) = (side(other, a), side(other, b));
    if from != to {
        let share = from as f64 / (from - to) as f64;
        return std::array::from_fn(|axis| a[axis] as f64 + share * (b[axis] - a[axis]) as f64);
    }
    let along = |place: &Place| {
        (0..2).map(|axis| i128::from(place[axis] - a[axis]) * i128::from(b[axis] - a[axis])).sum::<i128>()
    };
    let is_inside = |place: &Place| {
        let [low, high] = box_of(other);
        (0..2).all(|axis| (low[axis]..=high[axis]).contains(&place[axis]))
    };
    let first = if is_inside(&a) { a } else { other.into_iter().min_by_key(along).unwrap_or(a) };
    first.map(|number| number as f64)
}

/// Square of the distance of a place from a line, in parts of a step.
///
/// Whether an end is nearest is decided exactly, and then the square is that of the distance from that end, rounded once: so lines that meet in a vertex are equally
/// far where it is nearest. Otherwise it is rounded four times, in the same way whichever end is the first.
pub(crate) fn square_distance(line: [Place; 2], from: Place) -> f64 {
    let [a, b] = line;
    let difference =
        |p: Place, q: Place| [i128::from(q[0]) - i128::from(p[0]), i128::from(q[1]) - i128::from(p[1])];
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

/// Square of the distance of a place from a box, in parts of a step; somewhat less than it is, as distances from lines are rounded, and a box must not be passed
/// by for that.
#[inline]
pub(crate) fn square_to_box([low, high]: [Place; 2], from: Place) -> f64 {
    // (Differences are doubles as they are. Here a double is rounded three times, in the distance from a line seven times, by 2^-53 each.)
    const LESS: f64 = 1.0 - 1.0 / (1u64 << 49) as f64;
    let along = |axis: usize| (low[axis] - from[axis]).max(from[axis] - high[axis]).max(0) as f64;
    (along(0) * along(0) + along(1) * along(1)) * LESS
}

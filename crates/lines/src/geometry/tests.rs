//! Predicates, compared with other formulas.

use super::{FRACTION, FixedPosition, between, box_of, meet, meets_box, square_distance};
use crate::tests::random;

#[test]
fn boxes_intersect_lines_that_have_a_point_inside() {
    // Compared with Liang-Barsky clipping in floating point. For small coordinates, the tolerance
    // is below the gap between touching and missing.
    let mut random = random(8);
    for query in 0..40_000 {
        let mut position = || [random(7) as i64, random(7) as i64, (query % 2) * random(7) as i64];
        let (line, low, high) = ([position(), position()], position(), position());
        let [low, high] = box_of([low, high]);
        let mut shares = [0f64, 1.0];
        // Range of the line's parameter within the box, by clipping.
        let mut is_met = true;
        for axis in 0..3 {
            let along = line[1][axis] - line[0][axis];
            let (to_low, to_high) = (low[axis] - line[0][axis], high[axis] - line[0][axis]);
            if along == 0 {
                is_met &= to_low <= 0 && to_high >= 0;
            } else {
                let (first, last) = (to_low as f64 / along as f64, to_high as f64 / along as f64);
                shares = [shares[0].max(first.min(last)), shares[1].min(first.max(last))];
            }
        }
        is_met &= shares[0] <= shares[1] + 1e-12;
        assert_eq!(meets_box(line, [low, high]), is_met, "{line:?} {low:?} {high:?}");
    }
}

/// Whether segments with small coordinates meet, by parameters along them: those of the nearest
/// points of their lines, or of the ends along parallel lines.
fn meet_by_parameters([a, b]: [FixedPosition; 2], [c, d]: [FixedPosition; 2]) -> bool {
    let minus = |p: FixedPosition, q: FixedPosition| [0, 1, 2].map(|axis| p[axis] - q[axis]);
    let dot = |p: FixedPosition, q: FixedPosition| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    let cross = |p: FixedPosition, q: FixedPosition| {
        [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
    };
    let (one, other, gap) = (minus(b, a), minus(d, c), minus(c, a));
    let normal = cross(one, other);
    if normal != [0; 3] {
        let square = dot(normal, normal);
        let shares = [other, one].map(|along| dot(cross(gap, along), normal));
        return dot(normal, gap) == 0 && shares.iter().all(|share| (0..=square).contains(share));
    }
    if one == [0; 3] && other == [0; 3] {
        return a == c;
    }
    // A point has no direction of its own.
    let along = if one == [0; 3] { other } else { one };
    if cross(along, gap) != [0; 3] {
        return false;
    }
    let positions = [a, b, c, d].map(|end| dot(along, minus(end, a)));
    positions[0].min(positions[1]) <= positions[2].max(positions[3])
        && positions[2].min(positions[3]) <= positions[0].max(positions[1])
}

#[test]
fn segments_meet_as_their_parameters_say() {
    let mut random = random(17);
    let (mut met, mut parallel) = (0, 0);
    for query in 0..60_000 {
        let side = 2 + query % 5;
        let mut position =
            || [random(side), random(side), (query % 3) * random(side) / 2].map(|at| at as i64);
        let (one, other) = ([position(), position()], [position(), position()]);
        let is_met = meet_by_parameters(one, other);
        assert_eq!(meet(one, other), is_met, "{one:?} {other:?}");
        assert_eq!(meet(other, one), is_met, "{one:?} {other:?}");
        met += usize::from(is_met);
        parallel += usize::from(is_met && query % 3 != 0 && one[0][2] != one[1][2]);
        let (square, at) = between(one, other);
        // Distances of points along one segment are no smaller, and some are almost equal.
        let sampled = (0..=64).map(|step| {
            let share = f64::from(step) / 64.0;
            let on = [0, 1, 2].map(|axis| {
                (one[0][axis] * FRACTION) as f64 + share * ((one[1][axis] - one[0][axis]) * FRACTION) as f64
            });
            let ends = other.map(|end| end.map(|number| number * FRACTION));
            square_distance(ends, on.map(|number| number.round() as i64)).sqrt() / FRACTION as f64
        });
        let least = sampled.fold(f64::INFINITY, f64::min);
        if !is_met {
            assert!(square.sqrt() <= least + 1e-4 && square.sqrt() >= least - 0.1, "{one:?} {other:?}");
            assert!(
                square_distance(other, at.map(|number| number.round() as i64)).sqrt() <= square.sqrt() + 1.0
            );
        }
    }
    assert!(met > 5000 && parallel > 500, "{met} {parallel}");
}

#[test]
fn segments_of_extreme_length_meet_exactly() {
    // The volume that such segments span exceeds 128 bits.
    let mut random = random(23);
    for _ in 0..2000 {
        let mut vector = || [0; 3].map(|_: i64| random(1 << 46) as i64 - (1 << 45));
        let (middle, one, other) = (vector(), vector(), vector());
        let plus = |sign: i64, by: FixedPosition| [0, 1, 2].map(|axis| middle[axis] + sign * by[axis]);
        let (first, second) = ([plus(-1, one), plus(1, one)], [plus(-1, other), plus(1, other)]);
        assert!(meet(first, second));
        for axis in 0..3 {
            let mut moved = second;
            moved.iter_mut().for_each(|end| end[axis] += 1);
            assert!(!meet(first, moved), "{first:?} {moved:?}");
            let (square, _) = between(first, moved);
            assert!(square < 1.5, "{square}");
        }
    }
}

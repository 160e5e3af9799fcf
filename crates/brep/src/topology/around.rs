//! Exact cyclic order around a point of a plane or around an edge.

use std::cmp::Ordering;

use crate::exact::normal::newell;
use crate::exact::vector::others;
use spinney_base::sort;

/// The direction of something around a point of a plane, or around an edge seen along itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct Direction {
    /// The direction, not zero; below 2^62 in magnitude, so that products fit.
    pub(super) at: [i128; 2],
    /// Whether the solid side ends here in counterclockwise order; otherwise, it begins here.
    pub(super) closes: bool,
    /// Number of the item with this direction.
    pub(super) number: u32,
}

/// Pairs the directions that bound a solid sector: each begin with the next end, counterclockwise.
/// Directions without a counterpart stay unpaired.
///
/// Of equal directions, ends precede begins: solids that only touch stay separate.
pub(super) fn pair_around(directions: &mut [Direction]) -> Vec<[u32; 2]> {
    sort::by(directions, &mut |a, b| {
        let by_angle = compare_angles(a.at, b.at);
        by_angle.then(b.closes.cmp(&a.closes)).then(a.number.cmp(&b.number))
    });
    let mut pairs = Vec::with_capacity(directions.len() / 2);
    let mut is_paired = vec![false; directions.len()];
    let mut begun = Vec::new();
    // Two turns, since a sector may begin before the first direction.
    for round in 0..2 {
        for (index, direction) in directions.iter().enumerate().filter(|(_, at)| at.closes || round == 0) {
            if !direction.closes {
                begun.push(direction.number);
            } else if !is_paired[index]
                && let Some(begins) = begun.pop()
            {
                is_paired[index] = true;
                pairs.push([begins, direction.number]);
            }
        }
    }
    pairs
}

/// Compares the angles of two directions, counterclockwise from the first axis.
fn compare_angles(a: [i128; 2], b: [i128; 2]) -> Ordering {
    let is_lower = |[x, y]: [i128; 2]| y < 0 || y == 0 && x < 0;
    let cross = a[0] * b[1] - a[1] * b[0];
    is_lower(a).cmp(&is_lower(b)).then(0.cmp(&cross))
}

/// Returns the normal of rings by Newell's method, as the shortest integer vector; zero if they
/// enclose nothing.
///
/// For a planar face with coordinates of 26 bits, components are below 2^54. For other faces, they
/// may be larger, and then lose their low bits.
pub(super) fn normal<'a>(rings: impl Iterator<Item = &'a [[i32; 3]]>) -> [i128; 3] {
    let mut sum = [0i128; 3];
    for ring in rings {
        for (part, own) in sum.iter_mut().zip(newell(ring)) {
            *part += own;
        }
    }
    let divisor = sum.iter().fold(0, |divisor, part| common_divisor(divisor, part.unsigned_abs()));
    if divisor > 1 {
        sum = sum.map(|part| part / divisor as i128);
    }
    while sum.iter().any(|part| part.unsigned_abs() >> 62 > 0) {
        sum = sum.map(|part| part >> 1);
    }
    sum
}

fn common_divisor(mut a: u128, mut b: u128) -> u128 {
    while b > 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// Projects a vector along an axis, as seen against the axis' direction, or along it if
/// `is_turned`.
pub(super) fn flat(vector: [i128; 3], axis: usize, is_turned: bool) -> [i128; 2] {
    let [j, k] = others(axis);
    if is_turned { [vector[k], vector[j]] } else { [vector[j], vector[k]] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_in_order() {
        let around = [[1, 0], [3, 1], [1, 1], [0, 2], [-1, 1], [-1, 0], [-1, -1], [0, -1], [5, -1]];
        for (i, a) in around.iter().enumerate() {
            for (j, b) in around.iter().enumerate() {
                assert_eq!(compare_angles(*a, b.map(|x| 7 * x)), i.cmp(&j), "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn what_is_solid_lies_between_pairs() {
        let at = |x, y, closes, number| Direction { at: [x, y], closes, number };
        // Two quarters that touch along one direction, the second across the first axis.
        let mut quarters = [
            at(1, 0, false, 0),
            at(0, 1, true, 1),
            at(0, -1, false, 2),
            at(1, 0, true, 3),
            at(-1, 1, true, 4),
        ];
        let mut pairs = pair_around(&mut quarters);
        pairs.sort_unstable();
        assert_eq!(pairs, [[0, 1], [2, 3]]);
    }

    #[test]
    fn normals_are_short() {
        let ring = [[0, 0, 5], [6, 0, 5], [6, 6, 5], [0, 6, 5]];
        assert_eq!(normal([&ring[..]].into_iter()), [0, 0, 1]);
        assert_eq!(normal([&ring[..2]].into_iter()), [0; 3]);
    }
}

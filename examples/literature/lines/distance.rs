//! Exact distances.

use std::cmp::Ordering;

use super::edge_tree::Edge;

/// Square of a distance: an integer and a fraction below 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Square {
    whole: u128,
    /// Numerator and denominator.
    above: u128,
    below: u128,
}

impl Square {
    pub(super) fn whole(whole: u128) -> Square {
        Square { whole, above: 0, below: 1 }
    }

    pub(super) fn to_f64(self) -> f64 {
        self.whole as f64 + self.above as f64 / self.below as f64
    }
}

impl PartialOrd for Square {
    fn partial_cmp(&self, other: &Square) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Square {
    fn cmp(&self, other: &Square) -> Ordering {
        // (Squares of lengths have fewer than 62 bits.)
        self.whole.cmp(&other.whole).then((self.above * other.below).cmp(&(other.above * self.below)))
    }
}

/// Returns the square of a point's distance from an edge.
pub(super) fn of_edge<const N: usize>([a, b]: Edge<N>, place: [i32; N]) -> Square {
    let difference = |p: [i32; N], q: [i32; N]| -> [i128; N] {
        std::array::from_fn(|axis| i128::from(q[axis]) - i128::from(p[axis]))
    };
    let dot = |p: [i128; N], q: [i128; N]| p.iter().zip(q).map(|(p, q)| p * q).sum::<i128>();
    let (along, from_a, from_b) = (difference(a, b), difference(a, place), difference(b, place));
    let forward = dot(along, from_a);
    if forward <= 0 {
        return Square::whole(dot(from_a, from_a) as u128);
    }
    if dot(along, from_b) >= 0 {
        return Square::whole(dot(from_b, from_b) as u128);
    }
    let length = dot(along, along);
    let (above, below) = ((dot(from_a, from_a) * length - forward * forward) as u128, length as u128);
    Square { whole: above / below, above: above % below, below }
}

/// Returns the square of a point's distance from a box, its maximum sides included.
pub(super) fn of_box<const N: usize>((low, high): ([i64; N], [i64; N]), place: [i32; N]) -> Square {
    let along = |axis: usize| {
        let at = i64::from(place[axis]);
        (low[axis] - at).max(at - high[axis]).max(0) as u128
    };
    Square::whole((0..N).map(|axis| along(axis) * along(axis)).sum())
}

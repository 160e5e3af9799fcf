//! The part of an edge in a block.

use super::edge_tree::Edge;

/// A share of the way along an edge: a fraction with a denominator above 0.
#[derive(Clone, Copy)]
struct Share {
    above: i64,
    below: i64,
}

impl Share {
    /// Above 0 if it is greater than another one. (Numbers have fewer than 31 bits, so that products have fewer than 62.)
    fn compare(self, other: Share) -> std::cmp::Ordering {
        (self.above * other.below).cmp(&(other.above * self.below))
    }
}

/// An end of the part: how far along, and whether the part has it.
#[derive(Clone, Copy)]
struct End {
    share: Share,
    has: bool,
}

/// Whether an edge has a place in a box with a least and a greatest corner; the greatest sides belong to it if that is said, the least ones always do.
pub(super) fn passes<const N: usize>(
    [a, b]: Edge<N>,
    (low, high): ([i64; N], [i64; N]),
    has_greatest: bool,
) -> bool {
    let mut first = End { share: Share { above: 0, below: 1 }, has: true };
    let mut last = End { share: Share { above: 1, below: 1 }, has: true };
    for axis in 0..N {
        let from = i64::from(a[axis]);
        let along = i64::from(b[axis]) - from;
        if along == 0 {
            if from < low[axis] || from > high[axis] || from == high[axis] && !has_greatest {
                return false;
            }
            continue;
        }
        let below = along.abs();
        let least = End { share: Share { above: (low[axis] - from) * along.signum(), below }, has: true };
        let greatest =
            End { share: Share { above: (high[axis] - from) * along.signum(), below }, has: has_greatest };
        let (enter, leave) = if along > 0 { (least, greatest) } else { (greatest, least) };
        match enter.share.compare(first.share) {
            std::cmp::Ordering::Greater => first = enter,
            std::cmp::Ordering::Equal => first.has &= enter.has,
            std::cmp::Ordering::Less => {}
        }
        match leave.share.compare(last.share) {
            std::cmp::Ordering::Less => last = leave,
            std::cmp::Ordering::Equal => last.has &= leave.has,
            std::cmp::Ordering::Greater => {}
        }
    }
    match first.share.compare(last.share) {
        std::cmp::Ordering::Less => true,
        std::cmp::Ordering::Equal => first.has && last.has,
        std::cmp::Ordering::Greater => false,
    }
}

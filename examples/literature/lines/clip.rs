//! Clipping of an edge to a block.

use super::edge_tree::Edge;

/// Position along an edge: a fraction with a positive denominator.
#[derive(Clone, Copy)]
struct Share {
    above: i64,
    below: i64,
}

impl Share {
    /// Compares two fractions. (Numbers have fewer than 31 bits, so that products have fewer than
    /// 62.)
    fn compare(self, other: Share) -> std::cmp::Ordering {
        (self.above * other.below).cmp(&(other.above * self.below))
    }
}

/// End of the clipped edge: its position, and whether it is included.
#[derive(Clone, Copy)]
struct End {
    share: Share,
    has: bool,
}

/// Returns whether an edge has a point in a box, given by its minimum and maximum. The minimum
/// sides belong to the box, the maximum ones only if requested.
pub(super) fn passes<const N: usize>(
    [a, b]: Edge<N>,
    (low, high): ([i64; N], [i64; N]),
    includes_max: bool,
) -> bool {
    let mut first = End { share: Share { above: 0, below: 1 }, has: true };
    let mut last = End { share: Share { above: 1, below: 1 }, has: true };
    for axis in 0..N {
        let from = i64::from(a[axis]);
        let along = i64::from(b[axis]) - from;
        if along == 0 {
            if from < low[axis] || from > high[axis] || from == high[axis] && !includes_max {
                return false;
            }
            continue;
        }
        let below = along.abs();
        let min = End { share: Share { above: (low[axis] - from) * along.signum(), below }, has: true };
        let max =
            End { share: Share { above: (high[axis] - from) * along.signum(), below }, has: includes_max };
        let (enter, leave) = if along > 0 { (min, max) } else { (max, min) };
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

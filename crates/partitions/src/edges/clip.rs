//! Clipping of an edge to a block.

use super::edge_tree::Edge;

/// Position along an edge: a fraction with a positive denominator.
#[derive(Clone, Copy)]
struct Share {
    above: i128,
    below: i128,
}

impl Share {
    /// Compares two fractions. (Numbers have at most 33 bits, so that products have at most 66.)
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
pub(super) fn passes([a, b]: Edge, [low, high]: [[i64; 3]; 2], includes_max: bool) -> bool {
    let mut first = End { share: Share { above: 0, below: 1 }, has: true };
    let mut last = End { share: Share { above: 1, below: 1 }, has: true };
    for axis in 0..3 {
        let from = a[axis];
        let along = b[axis] - from;
        if along == 0 {
            if from < low[axis] || from > high[axis] || from == high[axis] && !includes_max {
                return false;
            }
            continue;
        }
        let below = i128::from(along.abs());
        let share = |at: i64| Share { above: i128::from((at - from) * along.signum()), below };
        let min = End { share: share(low[axis]), has: true };
        let max = End { share: share(high[axis]), has: includes_max };
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

//! Spatial index of a block's points for nearest-neighbour search.

use std::collections::BinaryHeap;

/// Point of a block.
#[derive(Clone, Copy, Debug)]
pub(super) struct IndexedPoint {
    /// World coordinates.
    pub place: [f64; 3],
    /// Index in the block.
    pub number: u32,
    /// Split axis of its range, unless the range is small.
    pub axis: u8,
}

/// k-d tree (Bentley 1975) without pointers. The median point of each range splits it along the
/// longest side.
pub(super) struct BlockIndex {
    points: Vec<IndexedPoint>,
}

/// Ranges of at most this many points are searched linearly.
const SMALL: usize = 8;

/// Candidate for a nearest point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    /// Squared distance.
    pub square: f64,
    /// Block number, and index in the block.
    pub number: (u32, u32),
    pub place: [f64; 3],
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Candidate) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    /// Orders by distance, then by number.
    fn cmp(&self, other: &Candidate) -> std::cmp::Ordering {
        self.square.total_cmp(&other.square).then(self.number.cmp(&other.number))
    }
}

/// Best points of one query so far.
pub(super) struct Best {
    /// Max-heap: the farthest candidate is on top.
    heap: BinaryHeap<Candidate>,
    most: usize,
    /// Squared distance that better points must not exceed.
    pub limit: f64,
    /// Number of axes that count.
    axes: usize,
}

impl Best {
    /// Keeps at most `most` points, whose squared distances do not exceed `limit`.
    pub(super) fn new(most: usize, limit: f64, axes: usize) -> Best {
        Best { heap: BinaryHeap::new(), most, limit, axes }
    }

    #[inline]
    fn look(&mut self, from: [f64; 3], point: &IndexedPoint, block: u32) {
        let along = |axis: usize| (point.place[axis] - from[axis]) * (point.place[axis] - from[axis]);
        let square = along(0) + along(1) + if self.axes == 3 { along(2) } else { 0.0 };
        if square <= self.limit {
            self.add(Candidate { square, number: (block, point.number), place: point.place });
        }
    }

    fn add(&mut self, candidate: Candidate) {
        if self.heap.len() < self.most {
            self.heap.push(candidate);
        } else if let Some(mut worst) = self.heap.peek_mut()
            && candidate < *worst
        {
            *worst = candidate;
        }
        if self.heap.len() == self.most
            && let Some(worst) = self.heap.peek()
        {
            self.limit = self.limit.min(worst.square);
        }
    }

    /// Returns the points found, nearest first.
    pub(super) fn finish(self) -> Vec<Candidate> {
        self.heap.into_sorted_vec()
    }
}

impl BlockIndex {
    /// Builds the index of points; the first `axes` axes count.
    pub(super) fn new(mut points: Vec<IndexedPoint>, axes: usize) -> BlockIndex {
        let mut ranges = vec![(0, points.len())];
        while let Some((first, last)) = ranges.pop() {
            let range = &mut points[first..last];
            if range.len() <= SMALL {
                continue;
            }
            let side = |axis: usize| {
                let along = range.iter().map(|point| point.place[axis]);
                let (least, most) =
                    along.fold((f64::MAX, f64::MIN), |(least, most), at| (least.min(at), most.max(at)));
                most - least
            };
            let axis = (0..axes).max_by(|a, b| side(*a).total_cmp(&side(*b))).unwrap_or(0);
            let middle = range.len() / 2;
            range.select_nth_unstable_by(middle, |a, b| a.place[axis].total_cmp(&b.place[axis]));
            range[middle].axis = axis as u8;
            ranges.push((first, first + middle));
            ranges.push((first + middle + 1, last));
        }
        BlockIndex { points }
    }

    /// Returns the memory size in bytes.
    pub(super) fn bytes(&self) -> u64 {
        (self.points.len() * size_of::<IndexedPoint>()) as u64
    }

    /// Searches for better points. `beside` is the squared distance to the bounding box along each
    /// axis.
    pub(super) fn search(&self, block: u32, from: [f64; 3], beside: [f64; 3], best: &mut Best) {
        search(&self.points, block, from, beside, best);
    }
}

/// Searches a range, which lies in a box, for better points. The recursion depth is at most the
/// number of bits of the range's length, since ranges are halved.
///
/// The far half is bounded by the split point along the split axis, and by the box along the
/// others. Its distance is thus known without visiting it (Arya and Mount 1993).
fn search(range: &[IndexedPoint], block: u32, from: [f64; 3], beside: [f64; 3], best: &mut Best) {
    if range.len() <= SMALL {
        return range.iter().for_each(|point| best.look(from, point, block));
    }
    let (before, rest) = range.split_at(range.len() / 2);
    let Some((middle, behind)) = rest.split_first() else { return };
    let axis = usize::from(middle.axis);
    if axis >= best.axes {
        // An axis that does not count prunes nothing.
        search(before, block, from, beside, best);
        best.look(from, middle, block);
        return search(behind, block, from, beside, best);
    }
    let beyond = from[axis] - middle.place[axis];
    let (near, far) = if beyond < 0.0 { (before, behind) } else { (behind, before) };
    search(near, block, from, beside, best);
    let mut farther = beside;
    farther[axis] = farther[axis].max(beyond * beyond);
    if farther[0] + farther[1] + farther[2] <= best.limit {
        best.look(from, middle, block);
        search(far, block, from, farther, best);
    }
}

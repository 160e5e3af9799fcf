//! Spatial index of a block's points for nearest-neighbour search.

use std::collections::BinaryHeap;

/// Point of a block.
#[derive(Clone, Copy, Debug)]
pub(super) struct IndexedPoint {
    /// World coordinates.
    pub position: [f64; 3],
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
    pub position: [f64; 3],
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
    max_count: usize,
    /// Squared distance that better points must not exceed.
    pub limit: f64,
    /// Number of axes that count.
    axes: usize,
}

impl Best {
    /// Keeps at most `max_count` points, whose squared distances do not exceed `limit`.
    pub(super) fn new(max_count: usize, limit: f64, axes: usize) -> Best {
        Best { heap: BinaryHeap::new(), max_count, limit, axes }
    }

    #[inline]
    fn offer(&mut self, from: [f64; 3], point: &IndexedPoint, block: u32) {
        let along = |axis: usize| (point.position[axis] - from[axis]) * (point.position[axis] - from[axis]);
        let square = along(0) + along(1) + if self.axes == 3 { along(2) } else { 0.0 };
        if square <= self.limit {
            self.add(Candidate { square, number: (block, point.number), position: point.position });
        }
    }

    fn add(&mut self, candidate: Candidate) {
        if self.heap.len() < self.max_count {
            self.heap.push(candidate);
        } else if let Some(mut worst) = self.heap.peek_mut()
            && candidate < *worst
        {
            *worst = candidate;
        }
        if self.heap.len() == self.max_count
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
                let along = range.iter().map(|point| point.position[axis]);
                let (low, high) =
                    along.fold((f64::MAX, f64::MIN), |(low, high), at| (low.min(at), high.max(at)));
                high - low
            };
            let axis = (0..axes).max_by(|a, b| side(*a).total_cmp(&side(*b))).unwrap_or(0);
            let middle = range.len() / 2;
            range.select_nth_unstable_by(middle, |a, b| a.position[axis].total_cmp(&b.position[axis]));
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

    /// Searches for better points. `squares` is the squared distance to the bounding box along each
    /// axis.
    pub(super) fn search(&self, block: u32, from: [f64; 3], squares: [f64; 3], best: &mut Best) {
        search(&self.points, block, from, squares, best);
    }
}

/// Searches a range, which lies in a box, for better points. The recursion depth is at most the
/// number of bits of the range's length, since ranges are halved.
///
/// The far half is bounded by the split point along the split axis, and by the box along the
/// others. Its distance is thus known without visiting it (Arya and Mount 1993).
fn search(range: &[IndexedPoint], block: u32, from: [f64; 3], squares: [f64; 3], best: &mut Best) {
    if range.len() <= SMALL {
        return range.iter().for_each(|point| best.offer(from, point, block));
    }
    let (before, rest) = range.split_at(range.len() / 2);
    let Some((middle, after)) = rest.split_first() else { return };
    let axis = usize::from(middle.axis);
    if axis >= best.axes {
        // An axis that does not count prunes nothing.
        search(before, block, from, squares, best);
        best.offer(from, middle, block);
        return search(after, block, from, squares, best);
    }
    let beyond = from[axis] - middle.position[axis];
    let (near, far) = if beyond < 0.0 { (before, after) } else { (after, before) };
    search(near, block, from, squares, best);
    let mut farther = squares;
    farther[axis] = farther[axis].max(beyond * beyond);
    if farther[0] + farther[1] + farther[2] <= best.limit {
        best.offer(from, middle, block);
        search(far, block, from, farther, best);
    }
}

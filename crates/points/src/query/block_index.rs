//! Points of a block, put so that those near a place are found fast.

use std::collections::BinaryHeap;

/// A point of a block.
#[derive(Clone, Copy, Debug)]
pub(super) struct IndexedPoint {
    /// Coordinates in the world.
    pub place: [f64; 3],
    /// Its number in the block.
    pub number: u32,
    /// The axis along which it divides its range, if that is not small.
    pub axis: u8,
}

/// A k-d tree (Bentley 1975) without pointers: the middle point of each range divides it along the range's longest side.
pub(super) struct BlockIndex {
    points: Vec<IndexedPoint>,
}

/// Ranges of so many points are looked through.
const SMALL: usize = 8;

/// A point that may be the answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    /// Square of its distance.
    pub square: f64,
    /// Its block, and its number there.
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
    /// By distance; of points that are equally far, by number.
    fn cmp(&self, other: &Candidate) -> std::cmp::Ordering {
        self.square.total_cmp(&other.square).then(self.number.cmp(&other.number))
    }
}

/// The best points so far of one question.
pub(super) struct Best {
    /// The farthest is on top.
    heap: BinaryHeap<Candidate>,
    most: usize,
    /// Square of the distance that better points have at most.
    pub limit: f64,
    /// Number of axes that count.
    axes: usize,
}

impl Best {
    /// At most so many points, whose distance has at most that square.
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

    /// The points that were found, the nearest first.
    pub(super) fn finish(self) -> Vec<Candidate> {
        self.heap.into_sorted_vec()
    }
}

impl BlockIndex {
    /// The index of points, of which so many axes count.
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

    /// Bytes of memory that it takes.
    pub(super) fn bytes(&self) -> u64 {
        (self.points.len() * size_of::<IndexedPoint>()) as u64
    }

    /// Looks for better points. `beside` are the squares of how far the place lies beside the box of all points, along each axis.
    pub(super) fn search(&self, block: u32, from: [f64; 3], beside: [f64; 3], best: &mut Best) {
        search(&self.points, block, from, beside, best);
    }
}

/// Looks for better points in a range, which lies in a box. (Ranges are halved: it goes no deeper than the bits of their length.)
///
/// On the far side of a middle point the box begins at it: how far that is away is known from the other axes, without looking (Arya and Mount 1993).
fn search(range: &[IndexedPoint], block: u32, from: [f64; 3], beside: [f64; 3], best: &mut Best) {
    if range.len() <= SMALL {
        return range.iter().for_each(|point| best.look(from, point, block));
    }
    let (before, rest) = range.split_at(range.len() / 2);
    let Some((middle, behind)) = rest.split_first() else { return };
    let axis = usize::from(middle.axis);
    if axis >= best.axes {
        // An axis that does not count excludes nothing.
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

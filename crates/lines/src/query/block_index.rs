//! In-memory index of a block's segments, for nearest and box queries.

use std::ops::Range;

use super::best::Best;
use crate::codec::LineSegment;
use crate::geometry::{
    FixedPosition, bounds_of, boxes_meet, ends, fixed_box, square_distance, square_to_box,
};
use crate::grid::{LineAxes, LineGrid};
use spinney_base::sort;

/// Fan-out: runs of equal segments, or boxes, per box.
const TOGETHER: usize = 8;

type Bounds = [[i32; 3]; 2];

/// Packed tree of bounding boxes without pointers. Segments are sorted by the codes of their
/// midpoints; each box bounds a few consecutive segments, or a few boxes of the level below. Equal
/// segments are indexed once, so duplicates do not slow down queries.
pub(super) struct BlockIndex {
    segments: Vec<LineSegment>,
    /// Start of each run of equal segments, which are sorted by feature and vertex. The last
    /// element is the number of segments.
    runs: Vec<u32>,
    /// Levels of boxes, from the segments up; the last level has at most `TOGETHER` boxes. Box `i`
    /// bounds the eight runs from `8 i` on in the first level, and the eight boxes from `8 i` on of
    /// the level below in others.
    levels: Vec<Vec<Bounds>>,
}

/// Hash of a segment's ends, so that sorting groups equal segments.
fn mixed(segment: &LineSegment) -> u64 {
    segment.ends.iter().flatten().fold(0, |mixed: u64, step| {
        (mixed.rotate_left(5) ^ u64::from(*step as u32)).wrapping_mul(0x9E37_79B9_7F4A_7C15)
    })
}

fn around(boxes: impl Iterator<Item = Bounds>) -> Bounds {
    boxes.fold([[i32::MAX; 3], [i32::MIN; 3]], |[low, high], [least, most]| {
        let low = std::array::from_fn(|axis| i32::min(low[axis], least[axis]));
        [low, std::array::from_fn(|axis| i32::max(high[axis], most[axis]))]
    })
}

impl BlockIndex {
    /// Builds the index of segments that are sorted by feature and vertex.
    pub(super) fn new(grid: &LineGrid, mut segments: Vec<LineSegment>) -> BlockIndex {
        let middle = |segment: &LineSegment| {
            let [a, b] = segment.ends;
            let middle = std::array::from_fn(|axis| ((i64::from(a[axis]) + i64::from(b[axis])) >> 1) as i32);
            grid.code([middle; 2]).map_or(0, |code| code.bits())
        };
        sort::by_wide_key(&mut segments, |segment| {
            u128::from(middle(segment)) << 64 | u128::from(mixed(segment))
        });
        let mut runs = vec![0];
        runs.extend(
            (1..segments.len()).filter(|at| segments[*at].ends != segments[*at - 1].ends).map(|at| at as u32),
        );
        let first = runs.chunks(TOGETHER).map(|own| {
            let boxes = own.iter().filter_map(|first| segments.get(*first as usize));
            around(boxes.map(|segment| bounds_of(segment.ends)))
        });
        let mut levels: Vec<Vec<Bounds>> = vec![first.collect()];
        while let Some(last) = levels.last().filter(|last| last.len() > TOGETHER) {
            let next = last.chunks(TOGETHER).map(|own| around(own.iter().copied())).collect();
            levels.push(next);
        }
        runs.push(segments.len() as u32);
        BlockIndex { segments, runs, levels }
    }

    /// Approximate bytes of memory.
    pub(super) fn bytes(&self) -> u64 {
        let boxes: usize = self.levels.iter().map(Vec::len).sum();
        (size_of_val(&self.segments[..]) + size_of_val(&self.runs[..]) + boxes * size_of::<Bounds>()) as u64
    }

    /// Offers segments to `best`, skipping boxes that are too distant along the axes.
    pub(super) fn search(&self, from: FixedPosition, axes: LineAxes, best: &mut Best) {
        let top = self.levels.len() - 1;
        self.search_level(top, 0..self.levels[top].len(), (from, axes), best);
    }

    fn search_level(
        &self,
        level: usize,
        range: Range<usize>,
        (from, axes): (FixedPosition, LineAxes),
        best: &mut Best,
    ) {
        let square = |bounds| square_to_box(axes.of(fixed_box(bounds)), from);
        for index in range {
            if square(self.levels[level][index]) > best.limit() {
                continue;
            }
            if let Some(next) = level.checked_sub(1) {
                self.search_level(next, below(index, self.levels[next].len()), (from, axes), best);
                continue;
            }
            for run in below(index, self.runs.len() - 1) {
                let run = self.run(run);
                let Some(first) = run.first() else { continue };
                if square(bounds_of(first.ends)) <= best.limit() {
                    best.offer_equal(square_distance(axes.of(ends(first.ends)), from), run);
                }
            }
        }
    }

    /// Segments of a run, which are equal.
    fn run(&self, run: usize) -> &[LineSegment] {
        &self.segments[self.runs[run] as usize..self.runs[run + 1] as usize]
    }

    /// Calls `each` for the segments whose bounding boxes intersect a box.
    pub(super) fn each_in(&self, wanted: [FixedPosition; 2], each: &mut dyn FnMut(&LineSegment)) {
        let top = self.levels.len() - 1;
        self.each_level(top, 0..self.levels[top].len(), wanted, each);
    }

    fn each_level(
        &self,
        level: usize,
        range: Range<usize>,
        wanted: [FixedPosition; 2],
        each: &mut dyn FnMut(&LineSegment),
    ) {
        for index in range {
            if !boxes_meet(fixed_box(self.levels[level][index]), wanted) {
                continue;
            }
            if let Some(next) = level.checked_sub(1) {
                self.each_level(next, below(index, self.levels[next].len()), wanted, each);
                continue;
            }
            for run in below(index, self.runs.len() - 1) {
                let run = self.run(run);
                if run.first().is_some_and(|first| boxes_meet(fixed_box(bounds_of(first.ends)), wanted)) {
                    run.iter().for_each(&mut *each);
                }
            }
        }
    }
}

/// Indices of a box's contents in the level below, which has `count` elements.
fn below(index: usize, count: usize) -> Range<usize> {
    index * TOGETHER..((index + 1) * TOGETHER).min(count)
}

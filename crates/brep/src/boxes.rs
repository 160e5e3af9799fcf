//! An in-memory tree over bounding boxes: a packed R-tree (Kamel and Faloutsos, 1993) whose boxes
//! are sorted by their centres along a space-filling curve, eight to a node.

use crate::curve;
use spinney_base::{Progress, Result, sort};

/// Minimum and maximum coordinates.
pub(crate) type Bounds = [[i32; 3]; 2];

const FAN_OUT: usize = 8;

/// A tree over boxes, which are identified by numbers.
pub(crate) struct BoxTree {
    /// Numbers of the boxes in the order of the lowest level.
    numbers: Vec<u32>,
    /// Boxes of each level, the lowest first: each covers eight of the level below.
    levels: Vec<Vec<Bounds>>,
}

/// Bytes of memory that a tree takes per box.
pub(crate) const BOX: usize = size_of::<Bounds>() * FAN_OUT / (FAN_OUT - 1) + 4;

impl BoxTree {
    /// Builds the tree over boxes in ascending order of their numbers.
    pub(crate) fn of(mut boxes: Vec<(u32, Bounds)>) -> BoxTree {
        debug_assert!(boxes.is_sorted_by_key(|(number, _)| *number));
        sort::by_key(&mut boxes, |(_, bounds)| curve::position_of_centre(bounds));
        let numbers = boxes.iter().map(|(number, _)| *number).collect();
        BoxTree::over(numbers, boxes.into_iter().map(|(_, bounds)| bounds).collect())
    }

    /// Builds the same tree as [`BoxTree::of`], for very many boxes.
    ///
    /// # Errors
    /// On cancellation.
    pub(crate) fn watched(boxes: &[(u32, Bounds)], progress: &dyn Progress) -> Result<BoxTree> {
        let key = |((_, bounds), place): (&(u32, Bounds), u128)| {
            u128::from(curve::position_of_centre(bounds)) << 64 | place
        };
        let mut keys: Vec<u128> = boxes.iter().zip(0..).map(key).collect();
        sort::watched(&mut keys, progress)?;
        let sorted = || keys.iter().map(|key| boxes[*key as u64 as usize]);
        let numbers = sorted().map(|(number, _)| number).collect();
        Ok(BoxTree::over(numbers, sorted().map(|(_, bounds)| bounds).collect()))
    }

    /// Builds the tree over boxes that are sorted along the curve.
    fn over(numbers: Vec<u32>, boxes: Vec<Bounds>) -> BoxTree {
        let mut levels = vec![boxes];
        while let Some(last) = levels.last().filter(|last| last.len() > 1) {
            let above =
                last.chunks(FAN_OUT).map(|boxes| boxes.iter().skip(1).fold(boxes[0], union)).collect();
            levels.push(above);
        }
        BoxTree { numbers, levels }
    }

    /// Returns the number of boxes.
    pub(crate) fn len(&self) -> usize {
        self.numbers.len()
    }

    /// Visits the numbers of all boxes that pass a test. The test must be monotone: a box that
    /// contains a passing box passes, too.
    pub(crate) fn each(&self, meets: &impl Fn(&Bounds) -> bool, mut each: impl FnMut(u32)) {
        let top = self.levels.len() - 1;
        for place in 0..self.levels[top].len() {
            self.each_below(top, place, meets, &mut each);
        }
    }

    fn each_below(
        &self,
        level: usize,
        place: usize,
        meets: &impl Fn(&Bounds) -> bool,
        each: &mut impl FnMut(u32),
    ) {
        if !meets(&self.levels[level][place]) {
            return;
        }
        match level {
            0 => each(self.numbers[place]),
            _ => self.children(level, place).for_each(|child| self.each_below(level - 1, child, meets, each)),
        }
    }

    /// Returns whether any box shares a point with `bounds`.
    pub(crate) fn touches(&self, bounds: &Bounds) -> bool {
        let top = self.levels.len() - 1;
        (0..self.levels[top].len()).any(|place| self.touches_below(top, place, bounds))
    }

    fn touches_below(&self, level: usize, place: usize, bounds: &Bounds) -> bool {
        touch(&self.levels[level][place], bounds)
            && (level == 0
                || self.children(level, place).any(|child| self.touches_below(level - 1, child, bounds)))
    }
}

/// Returns the bounding box of points, grown by `more` on all sides.
pub(crate) fn bounds_of(points: &[[i32; 3]], more: i32) -> Bounds {
    points.iter().fold([[i32::MAX; 3], [i32::MIN; 3]], |[low, high], point| {
        [
            [0, 1, 2].map(|axis| low[axis].min(point[axis] - more)),
            [0, 1, 2].map(|axis| high[axis].max(point[axis] + more)),
        ]
    })
}

impl BoxTree {
    /// Returns groups of neighbouring boxes, of at most 512 each.
    pub(crate) fn groups(&self) -> Vec<BoxGroup> {
        let level = (self.levels.len() - 1).min(3);
        (0..self.levels[level].len()).map(|place| BoxGroup { level, place }).collect()
    }

    /// Visits the pairs of a box of a group and a box of another tree that touch, in no particular
    /// order.
    pub(crate) fn pairs_of(&self, group: &BoxGroup, other: &BoxTree, each: &mut dyn FnMut([u32; 2])) {
        let top = other.levels.len() - 1;
        let mut open: Vec<[(usize, usize); 2]> =
            (0..other.levels[top].len()).map(|place| [(group.level, group.place), (top, place)]).collect();
        while let Some([(level, place), (other_level, other_place)]) = open.pop() {
            if !touch(&self.levels[level][place], &other.levels[other_level][other_place]) {
                continue;
            }
            if level == 0 && other_level == 0 {
                each([self.numbers[place], other.numbers[other_place]]);
            } else if level >= other_level {
                let children = self.children(level, place);
                open.extend(children.map(|child| [(level - 1, child), (other_level, other_place)]));
            } else {
                let children = other.children(other_level, other_place);
                open.extend(children.map(|child| [(level, place), (other_level - 1, child)]));
            }
        }
    }

    /// Returns the children of a node above the lowest level.
    fn children(&self, level: usize, place: usize) -> std::ops::Range<usize> {
        let first = place * FAN_OUT;
        first..(first + FAN_OUT).min(self.levels[level - 1].len())
    }
}

/// Neighbouring boxes: those below a node of a tree.
pub(crate) struct BoxGroup {
    level: usize,
    place: usize,
}

/// Returns the bounding box of two boxes.
pub(crate) fn union([low, high]: Bounds, [other_low, other_high]: &Bounds) -> Bounds {
    [
        [0, 1, 2].map(|axis| low[axis].min(other_low[axis])),
        [0, 1, 2].map(|axis| high[axis].max(other_high[axis])),
    ]
}

/// Returns whether two boxes share a point.
pub(crate) fn touch([low, high]: &Bounds, [other_low, other_high]: &Bounds) -> bool {
    // (Without branches, which would be mispredicted.)
    (0..3)
        .fold(true, |so_far, axis| so_far & (low[axis] <= other_high[axis]) & (other_low[axis] <= high[axis]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_that_touch_are_found() {
        let mut state = 3u64;
        let mut number = |below: u64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            ((state >> 33) % below) as i32
        };
        for count in [0, 1, 2, 9, 700] {
            let boxes: Vec<(u32, Bounds)> = (0..count)
                .map(|i| {
                    let low = [number(1 << 20), number(1 << 20), number(1 << 20)];
                    (3 * i + 1, [low, low.map(|at| at + number(1 << 17))])
                })
                .collect();
            let tree = BoxTree::of(boxes.clone());
            let watched = BoxTree::watched(&boxes, &()).unwrap();
            assert!(watched.numbers == tree.numbers && watched.levels == tree.levels);
            for (_, wanted) in boxes.iter().take(50) {
                let mut found = Vec::new();
                tree.each(&|bounds| touch(bounds, wanted), |number| found.push(number));
                found.sort_unstable();
                let expected: Vec<u32> = boxes
                    .iter()
                    .filter(|(_, bounds)| touch(bounds, wanted))
                    .map(|(number, _)| *number)
                    .collect();
                assert_eq!(found, expected);
            }
            let few: Vec<(u32, Bounds)> = boxes.iter().copied().step_by(3).collect();
            let other = BoxTree::of(few.clone());
            let mut found: Vec<[u32; 2]> = Vec::new();
            for group in tree.groups() {
                tree.pairs_of(&group, &other, &mut |pair| found.push(pair));
            }
            found.sort_unstable();
            let mut expected: Vec<[u32; 2]> = Vec::new();
            for (number, bounds) in &boxes {
                let touching = few.iter().filter(|(_, other)| touch(bounds, other));
                expected.extend(touching.map(|(other, _)| [*number, *other]));
            }
            expected.sort_unstable();
            assert_eq!(found, expected);
        }
    }

    /// All pairs of intervals between five points, as in "Construction of the spatial intersection
    /// line of polygon meshes" (2012). The test of that paper misses boxes that are within the
    /// other box or touch it.
    #[test]
    fn intervals_touch_where_they_share_a_point() {
        let intervals: Vec<[i32; 2]> = (0..5).flat_map(|low| (low..5).map(move |high| [low, high])).collect();
        let (mut pairs, mut misjudged) = (0, 0);
        for &one in &intervals {
            for &other in &intervals {
                let shares =
                    (0..5).any(|at| one[0] <= at && at <= one[1] && other[0] <= at && at <= other[1]);
                for axis in 0..3 {
                    let of = |[low, high]: [i32; 2]| {
                        let mut bounds = [[0; 3], [4; 3]];
                        (bounds[0][axis], bounds[1][axis]) = (low, high);
                        bounds
                    };
                    assert_eq!(touch(&of(one), &of(other)), shares, "{one:?} {other:?}");
                }
                let is_over_end = other[0] < one[1] && other[1] >= one[1];
                let is_over_start = other[0] < one[0] && other[1] >= one[0];
                misjudged += u32::from((is_over_end || is_over_start) != shares);
                pairs += 1;
            }
        }
        assert_eq!((pairs, misjudged), (225, 70));
    }
}

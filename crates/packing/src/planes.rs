//! Dense blocks of numbers: each level coded by the one above it.
//!
//! A node's children are foretold from its own value and those of its neighbours, as if values changed evenly; where they do not, from what
//! that got wrong for the children that are known already. All first children of a level come first, as a plane of their own, then
//! all last ones, and so on: so all that foretells a plane is there when it begins, on all sides. The last plane is told by the sum of
//! siblings, which their parent knows but for its rounding, where representatives are means.

use crate::bits::BitCoder;
use crate::errors::{PlaneContexts, SIZES, SUM_SIZES, SUMS, code_error, code_sum, size_context};
use crate::samples::Whole;

/// A plane of children, and what foretells it: of other planes a child's number, the step to the node that has it, and its weight in
/// sixteenths.
struct Plane {
    child: usize,
    /// Siblings that are known.
    own: &'static [(usize, i32)],
    /// Children of neighbours.
    near: &'static [(usize, [isize; 3], i32)],
    /// The weight of what was wrong about siblings in what will be wrong, in parts of 64.
    own_size: u32,
}

/// The weight of what was wrong about neighbours' children, in parts of 64.
const NEAR_SIZE: u32 = 4;

const QUAD_PLANES: [Plane; 4] = [
    Plane { child: 0, own: &[], near: &[], own_size: 0 },
    Plane {
        child: 3,
        own: &[(0, -12)],
        near: &[(0, [1, 0, 0], 0), (0, [0, 1, 0], 0), (0, [1, 1, 0], 0)],
        own_size: 32,
    },
    Plane {
        child: 1,
        own: &[(0, -4), (3, -8)],
        near: &[(0, [1, 0, 0], 2), (3, [0, -1, 0], 2)],
        own_size: 16,
    },
    Plane {
        child: 2,
        own: &[(0, -8), (3, -8), (1, -11)],
        near: &[(0, [0, 1, 0], 1), (3, [-1, 0, 0], 1)],
        own_size: 11,
    },
];

const OCT_PLANES: [Plane; 8] = [
    Plane { child: 0, own: &[], near: &[], own_size: 0 },
    Plane { child: 7, own: &[(0, -12)], near: &[(0, [1, 1, 1], 0)], own_size: 32 },
    Plane { child: 1, own: &[(0, 1), (7, -3)], near: &[(0, [1, 0, 0], 2)], own_size: 16 },
    Plane { child: 6, own: &[(1, -10), (7, 1)], near: &[(7, [-1, 0, 0], 2)], own_size: 11 },
    Plane { child: 2, own: &[(0, 1), (7, -1), (6, 1)], near: &[(0, [0, 1, 0], 2)], own_size: 11 },
    Plane { child: 5, own: &[(2, -10), (7, 1)], near: &[(7, [0, -1, 0], 2)], own_size: 8 },
    Plane {
        child: 3,
        own: &[(7, 4), (1, 4), (2, 4), (0, -4), (6, -4), (5, -4)],
        near: &[(7, [0, 0, -1], 2)],
        own_size: 6,
    },
    Plane {
        child: 4,
        own: &[(3, -11), (0, -2), (7, -2), (1, -2), (6, -2), (2, -2), (5, -2)],
        near: &[(0, [0, 0, 1], 1)],
        own_size: 5,
    },
];

/// Values of all nodes of a level, with those at the border once more around them.
#[derive(Clone)]
pub(crate) struct Grid<T> {
    pub(crate) side: usize,
    pub(crate) axes: usize,
    values: Vec<T>,
}

impl<T: Whole> Grid<T> {
    pub(crate) fn new(side: usize, axes: usize) -> Grid<T> {
        Grid { side, axes, values: vec![T::default(); (side + 2).pow(axes as u32)] }
    }

    fn depth(&self) -> usize {
        if self.axes == 3 { self.side } else { 1 }
    }

    /// Where the row of some y and z begins, moved by a step.
    fn row(&self, y: usize, z: usize, step: [isize; 3]) -> usize {
        let wide = self.side + 2;
        let z = if self.axes == 3 { (z + 1).wrapping_add_signed(step[2]) } else { 0 };
        (z * wide + (y + 1).wrapping_add_signed(step[1])) * wide + 1usize.wrapping_add_signed(step[0])
    }

    pub(crate) fn at(&self, y: usize, z: usize, step: [isize; 3]) -> &[T] {
        let start = self.row(y, z, step);
        &self.values[start..start + self.side]
    }

    pub(crate) fn row_mut(&mut self, y: usize, z: usize) -> &mut [T] {
        let start = self.row(y, z, [0; 3]);
        &mut self.values[start..start + self.side]
    }

    /// Calls for each row with its number, y and z.
    pub(crate) fn each_row(&self, each: impl FnMut(usize, usize, usize)) {
        for_rows(self.side, self.axes, each);
    }

    /// Where the children with a number of a row of nodes stand in the grid of children: every second value.
    fn child_row(&self, child: usize, y: usize, z: usize) -> std::ops::Range<usize> {
        let start = self.row(2 * y + (child >> 1 & 1), 2 * z + (child >> 2), [(child & 1) as isize, 0, 0]);
        start..start + self.side - 1
    }

    /// Repeats the values at the border around all.
    pub(crate) fn pad(&mut self) {
        let (side, wide) = (self.side, self.side + 2);
        for row in self.values.chunks_exact_mut(wide) {
            (row[0], row[side + 1]) = (row[1], row[side]);
        }
        for plane in self.values.chunks_exact_mut(wide * wide) {
            plane.copy_within(wide..2 * wide, 0);
            plane.copy_within(side * wide..(side + 1) * wide, (side + 1) * wide);
        }
        if self.axes == 3 {
            let plane = wide * wide;
            self.values.copy_within(plane..2 * plane, 0);
            self.values.copy_within(side * plane..(side + 1) * plane, (side + 1) * plane);
        }
    }
}

/// Calls for each row of a level with its number, y and z.
pub(crate) fn for_rows(side: usize, axes: usize, mut each: impl FnMut(usize, usize, usize)) {
    let rows = (0..if axes == 3 { side } else { 1 }).flat_map(|z| (0..side).map(move |y| (y, z)));
    rows.enumerate().for_each(|(row, (y, z))| each(row, y, z));
}

/// Bits of the number of lowest bits that are 0.
const STEP_BITS: u32 = 6;

/// How a child is coded: by its error in one of [`SIZES`] contexts, from [`BY_SUM`] on by the sum of siblings, or not at all, if it is as its
/// parent.
const BY_SUM: u8 = SIZES as u8;
const NOT_AT_ALL: u8 = u8::MAX;
const _: () = assert!(SIZES + SUMS * SUM_SIZES < NOT_AT_ALL as usize);

/// Codes the children of levels.
pub(crate) struct LevelCoder<'c, T> {
    contexts: &'c mut PlaneContexts,
    planes: &'static [Plane],
    has_sums: bool,
    /// By how much each child of a plane is expected to differ from its parent: in parts of 64 unless there are steps.
    expected: Vec<T>,
    how: Vec<u8>,
    /// By how much it does.
    changes: Vec<T>,
}

impl<'c, T: Whole> LevelCoder<'c, T> {
    /// For trees with so many axes; `has_sums` says that representatives are means.
    pub(crate) fn new(contexts: &'c mut PlaneContexts, axes: usize, has_sums: bool) -> LevelCoder<'c, T> {
        let planes: &[Plane] = if axes == 2 { &QUAD_PLANES } else { &OCT_PLANES };
        LevelCoder { contexts, planes, has_sums, expected: Vec::new(), how: Vec::new(), changes: Vec::new() }
    }

    /// Codes the children of a level: `children` has those to be written, and gets those that are read. Which of them are VOID
    /// the bits of `void` tell, of each parent; those are as their parents.
    pub(crate) fn level<K: BitCoder>(
        &mut self,
        coder: &mut K,
        parents: &Grid<T>,
        children: &mut Grid<T>,
        void: Option<&[u8]>,
    ) {
        // Invariant: both sides compute with the same numbers. What is VOID has its parent's number from here on, whatever stands in
        // the plain block; a plane is foretold by parents and planes that are done; and arithmetic wraps round, so that hostile numbers
        // lead to other numbers and nothing else.
        let (side, planes) = (parents.side, self.planes);
        let step = self.code_step(coder, children, void);
        let slopes = Slopes::new(parents);
        let mut wrong: Vec<Grid<T>> = planes.iter().map(|_| Grid::new(0, parents.axes)).collect();
        // The sum of what children of the planes so far differ from their parents.
        let mut others = vec![T::default(); slopes.sizes.len()];
        for (number, plane) in planes.iter().enumerate() {
            self.foretell(plane, &wrong, &slopes, parents);
            if let Some(void) = void {
                self.how
                    .iter_mut()
                    .zip(void)
                    .filter(|(_, void)| *void >> plane.child & 1 == 1)
                    .for_each(|(how, _)| *how = NOT_AT_ALL);
            }
            if step > 0 {
                self.in_steps(step, parents);
            }
            if self.has_sums && number + 1 == planes.len() {
                match step {
                    0 => self.foretell_sums(&others, void),
                    _ => self.foretell_by_sums(&others, step, parents, void),
                }
            }
            self.changes.resize(slopes.sizes.len(), T::default());
            if !K::READS {
                parents.each_row(|row, y, z| {
                    let child = children.child_row(plane.child, y, z);
                    let changes = self.changes[row * side..][..side].iter_mut();
                    let parents = parents.at(y, z, [0; 3]);
                    changes
                        .zip(children.values[child].iter().step_by(2))
                        .zip(parents)
                        .for_each(|((change, child), parent)| *change = child.sub(*parent));
                });
            }
            self.code(coder, number, &others, step);
            let mut here = Grid::new(side, parents.axes);
            parents.each_row(|row, y, z| {
                let child = children.child_row(plane.child, y, z);
                let changes = &self.changes[row * side..][..side];
                let parents = parents.at(y, z, [0; 3]);
                let out = children.values[child].iter_mut().step_by(2);
                out.zip(changes).zip(parents).for_each(|((out, change), parent)| *out = parent.add(*change));
                let wrong = here.row_mut(y, z);
                slopes.evenly(row, plane.child, wrong);
                wrong
                    .iter_mut()
                    .zip(changes)
                    .for_each(|(wrong, change)| *wrong = change.times(64).sub(*wrong));
            });
            here.pad();
            wrong[plane.child] = here;
            others.iter_mut().zip(&self.changes).for_each(|(others, change)| *others = others.add(*change));
        }
    }

    /// Tells what children of a plane are expected to be, and the context by how wrong that may be.
    fn foretell(&mut self, plane: &Plane, wrong: &[Grid<T>], slopes: &Slopes<T>, parents: &Grid<T>) {
        let side = parents.side;
        self.expected.clear();
        self.how.clear();
        let (mut wrong_by, mut sizes) = (vec![T::default(); side], vec![T::Size::default(); side]);
        let mut evenly = vec![T::default(); side];
        parents.each_row(|row, y, z| {
            wrong_by.fill(T::default());
            sizes.fill(T::Size::default());
            for (child, weight) in plane.own {
                let others = wrong[*child].at(y, z, [0; 3]);
                weigh(&mut wrong_by, &mut sizes, others, *weight, plane.own_size);
            }
            for (child, step, weight) in plane.near {
                weigh(&mut wrong_by, &mut sizes, wrong[*child].at(y, z, *step), *weight, NEAR_SIZE);
            }
            slopes.evenly(row, plane.child, &mut evenly);
            let expected = evenly.iter().zip(&wrong_by).map(|(evenly, wrong)| evenly.add(wrong.down(4)));
            self.expected.extend(expected);
            let uneven = &slopes.sizes[row * side..][..side];
            let all =
                sizes.iter().zip(uneven).map(|(wrong, uneven)| T::grow(T::shrink(*wrong, 6), *uneven, 1));
            self.how.extend(all.map(|size| size_context(T::to_u64(size)) as u8));
        });
    }

    /// Goes over to sums of siblings: what they are expected to be, and their contexts.
    fn foretell_sums(&mut self, others: &[T], void: Option<&[u8]>) {
        let most = (SUMS / 2) as i64;
        for (at, (expected, how)) in self.expected.iter().zip(&mut self.how).enumerate() {
            // (Where a child is VOID, a mean tells less of the others.)
            if void.is_some_and(|void| void[at] != 0) {
                continue;
            }
            let others = others[at];
            let sum = expected.add(others.times(64));
            let halves = (sum.add(T::from_i64(16)).down(5).to_i64().clamp(-most, most) + most) as usize;
            let size = usize::from(*how / 2).clamp(1, SUM_SIZES) - 1;
            *how = BY_SUM + (halves * SUM_SIZES + size) as u8;
        }
    }

    /// Codes how many of the lowest bits are 0 in all children of a level.
    fn code_step<K: BitCoder>(&mut self, coder: &mut K, children: &Grid<T>, void: Option<&[u8]>) -> u32 {
        let mut all = 0;
        if !K::READS {
            for_rows(children.side, children.axes, |_, y, z| {
                for (x, child) in children.at(y, z, [0; 3]).iter().enumerate() {
                    let half = children.side / 2;
                    let parent = (z / 2 * half + y / 2) * half + x / 2;
                    let number = (x & 1) | (y & 1) << 1 | (z & 1) << 2;
                    if void.is_none_or(|void| void[parent] >> number & 1 == 0) {
                        all |= child.to_i64();
                    }
                }
            });
        }
        let step = if all == 0 { 0 } else { all.trailing_zeros() };
        match coder.bit(&mut self.contexts.has_steps, step > 0) {
            true => coder.short(step, STEP_BITS),
            false => 0,
        }
    }

    /// Goes over to errors in steps of a power of two: what is expected becomes what leads to the nearest step.
    fn in_steps(&mut self, step: u32, parents: &Grid<T>) {
        let side = parents.side;
        parents.each_row(|row, y, z| {
            let own = parents.at(y, z, [0; 3]);
            let expected = self.expected[row * side..][..side].iter_mut();
            let how = &mut self.how[row * side..][..side];
            for ((expected, how), own) in expected.zip(how).zip(own) {
                *expected = nearest_step(own.add(expected.add(T::from_i64(32)).down(6)), step).sub(*own);
                if *how != NOT_AT_ALL {
                    *how = how.saturating_sub(2 * step as u8);
                }
            }
        });
    }

    /// Goes over, in the last plane, to what makes the sum of siblings 0, or nearly so: in steps there is little else.
    fn foretell_by_sums(&mut self, others: &[T], step: u32, parents: &Grid<T>, void: Option<&[u8]>) {
        let side = parents.side;
        parents.each_row(|row, y, z| {
            for (x, own) in parents.at(y, z, [0; 3]).iter().enumerate() {
                let at = row * side + x;
                if void.is_none_or(|void| void[at] == 0) {
                    self.expected[at] = nearest_step(own.sub(others[at]), step).sub(*own);
                    self.how[at] = 0;
                }
            }
        });
    }

    /// Codes the changes of a plane.
    #[inline(never)]
    fn code<K: BitCoder>(&mut self, coder: &mut K, plane: usize, others: &[T], step: u32) {
        let errors = &mut self.contexts.errors[plane * SIZES..][..SIZES];
        let sums = &mut self.contexts.sums[..];
        let (how, expected, changes) = (&self.how[..], &self.expected[..], &mut self.changes[..]);
        // (What is expected is in parts of 64 unless there are steps.)
        let (half, parts) = if step == 0 { (32, 6) } else { (0, 0) };
        coder.many(|coder| {
            let all = changes.iter_mut().zip(expected).zip(how).zip(others);
            for (((change, expected), how), others) in all {
                if *how < BY_SUM {
                    let expected = expected.add(T::from_i64(half)).down(parts);
                    let error = change.sub(expected).to_i64() >> step;
                    let error = code_error(coder, errors, usize::from(*how), error);
                    *change = T::from_i64(error << step).add(expected);
                } else if *how != NOT_AT_ALL {
                    let sum = change.add(*others).to_i64();
                    let sum = code_sum(coder, sums, usize::from(*how - BY_SUM), sum);
                    *change = T::from_i64(sum).sub(*others);
                } else {
                    *change = T::default();
                }
            }
        });
    }
}

/// The multiple of a power of two that is nearest to a number.
#[inline(always)]
fn nearest_step<T: Whole>(number: T, step: u32) -> T {
    let half = T::from_i64((1i64 << step) >> 1);
    T::from_i64(number.add(half).to_i64() >> step << step)
}

/// Adds what is wrong with others to what is expected to be wrong, and to how much that may be.
fn weigh<T: Whole>(wrong: &mut [T], sizes: &mut [T::Size], others: &[T], weight: i32, size: u32) {
    for ((wrong, sizes), other) in wrong.iter_mut().zip(sizes).zip(others) {
        *wrong = wrong.add(other.times(weight));
        *sizes = T::grow(*sizes, other.size(), size);
    }
}

/// How the values of a level change from node to node.
struct Slopes<T: Whole> {
    side: usize,
    /// Differences of neighbours along each axis, and across (in quadtrees).
    along: [Vec<T>; 3],
    across: Vec<T>,
    /// How uneven it is there.
    sizes: Vec<T::Size>,
}

impl<T: Whole> Slopes<T> {
    fn new(parents: &Grid<T>) -> Slopes<T> {
        let (side, axes) = (parents.side, parents.axes);
        let nodes = side * side * parents.depth();
        let mut slopes = Slopes {
            side,
            along: std::array::from_fn(|axis| vec![T::default(); if axis < axes { nodes } else { 0 }]),
            across: vec![T::default(); if axes == 2 { nodes } else { 0 }],
            sizes: vec![Default::default(); nodes],
        };
        parents.each_row(|row, y, z| {
            let here = row * side..(row + 1) * side;
            let own = parents.at(y, z, [0; 3]);
            let sizes = &mut slopes.sizes[here.clone()];
            for axis in 0..axes {
                let mut step = [0; 3];
                step[axis] = 1;
                let after = parents.at(y, z, step);
                step[axis] = -1;
                let before = parents.at(y, z, step);
                let along = &mut slopes.along[axis][here.clone()];
                for x in 0..side {
                    let (up, down) = (after[x].sub(own[x]), own[x].sub(before[x]));
                    along[x] = up.add(down);
                    sizes[x] = T::grow(sizes[x], up.size(), 1);
                    sizes[x] = T::grow(sizes[x], down.size(), 1);
                    sizes[x] = T::grow(sizes[x], up.sub(down).size(), 2);
                }
            }
            if axes == 2 {
                let corners =
                    [[1, 1, 0], [-1, 1, 0], [1, -1, 0], [-1, -1, 0]].map(|step| parents.at(y, z, step));
                let across = &mut slopes.across[here];
                for x in 0..side {
                    let [a, b, c, d] = corners.map(|row| row[x].sub(own[x]));
                    across[x] = a.sub(b).sub(c).add(d);
                    let all =
                        [a, b, c, d].iter().fold(T::Size::default(), |sum, it| T::grow(sum, it.size(), 1));
                    sizes[x] = T::grow(sizes[x], T::shrink(all, 1), 1);
                }
            }
        });
        slopes
    }

    /// By how much the children with a number of a row of nodes differ from their parents in parts of 64, if values change evenly.
    fn evenly(&self, row: usize, child: usize, changes: &mut [T]) {
        let here = row * self.side..(row + 1) * self.side;
        let sign = |axis: usize| if child >> axis & 1 == 1 { 1 } else { -1 };
        changes.fill(T::default());
        for (axis, along) in self.along.iter().enumerate() {
            let along = along.get(here.clone()).unwrap_or_default();
            changes
                .iter_mut()
                .zip(along)
                .for_each(|(change, along)| *change = change.add(along.times(8 * sign(axis))));
        }
        let across = self.across.get(here).unwrap_or_default();
        let sign = sign(0) * sign(1);
        changes.iter_mut().zip(across).for_each(|(change, across)| *change = change.add(across.times(sign)));
    }
}

//! Dense blocks of numbers: each level coded by the one above it.
//!
//! A node's children are foretold from its own value and those of its neighbours, as if values changed evenly; where they do not, from what
//! that got wrong for the children that are known already. All first children of a level come first, as a plane of their own, then
//! all last ones, and so on: so all that foretells a plane is there when it begins, on all sides. The last plane is told by the sum of
//! siblings, which their parent knows but for its rounding, where representatives are means.

use spinney_base::Form;
use spinney_base::value::Rule;

use crate::bits::{AdaptiveSymbols, BitCoder, SYMBOLS};
use crate::initial;
use crate::layout::{Dense, Layout, VOID};
use crate::masks::code_mask;
use crate::samples::{self, Whole, is_narrow};

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
struct Grid<T> {
    side: usize,
    axes: usize,
    values: Vec<T>,
}

impl<T: Whole> Grid<T> {
    fn new(side: usize, axes: usize) -> Grid<T> {
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

    fn at(&self, y: usize, z: usize, step: [isize; 3]) -> &[T] {
        let start = self.row(y, z, step);
        &self.values[start..start + self.side]
    }

    fn row_mut(&mut self, y: usize, z: usize) -> &mut [T] {
        let start = self.row(y, z, [0; 3]);
        &mut self.values[start..start + self.side]
    }

    /// Calls for each row with its number, y and z.
    fn each_row(&self, each: impl FnMut(usize, usize, usize)) {
        for_rows(self.side, self.axes, each);
    }

    /// Where the children with a number of a row of nodes stand in the grid of children: every second value.
    fn child_row(&self, child: usize, y: usize, z: usize) -> std::ops::Range<usize> {
        let start = self.row(2 * y + (child >> 1 & 1), 2 * z + (child >> 2), [(child & 1) as isize, 0, 0]);
        start..start + self.side - 1
    }

    /// Repeats the values at the border around all.
    fn pad(&mut self) {
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
fn for_rows(side: usize, axes: usize, mut each: impl FnMut(usize, usize, usize)) {
    let rows = (0..if axes == 3 { side } else { 1 }).flat_map(|z| (0..side).map(move |y| (y, z)));
    rows.enumerate().for_each(|(row, (y, z))| each(row, y, z));
}

/// Contexts of a plane by how much is expected to be wrong: two per doubling.
pub(crate) const SIZES: usize = 128;
/// Contexts of sums: by what they are expected to be, in halves from -2 to 2, and by how much is expected to be wrong.
const SUMS: usize = 9;
const SUM_SIZES: usize = 8;
/// The symbol of a sum of 0.
const NO_SUM: i64 = 8;
/// From this context on, the lower bits of what is wrong are as often set as not: one more per doubling.
const NOISE: usize = 14;

/// The context of a size: two per doubling.
#[inline(always)]
pub(crate) fn size_context(size: u64) -> usize {
    if size < 2 {
        return size as usize;
    }
    let bits = (u64::BITS - size.leading_zeros()) as usize;
    2 * bits - 2 + (size >> (bits - 2) & 1) as usize
}

/// Probabilities for one channel.
pub(crate) struct PlaneContexts {
    errors: Vec<AdaptiveSymbols>,
    sums: Vec<AdaptiveSymbols>,
}

impl PlaneContexts {
    fn new(children: usize) -> PlaneContexts {
        let errors = (0..children * SIZES).map(|at| initial::of_errors(at % SIZES)).collect();
        let sums = (0..SUMS * SUM_SIZES).map(|at| initial::of_sums(at / SUM_SIZES)).collect();
        PlaneContexts { errors, sums }
    }
}

/// The least number of each symbol, and how many bits tell the others.
static FIRST_OF: [(u8, u8); SYMBOLS] = {
    let mut all = [(0, 0); SYMBOLS];
    let mut symbol = 0;
    while symbol < SYMBOLS {
        let lower = if symbol < 4 { 0 } else { symbol / 2 - 1 };
        let first = if symbol < 4 { symbol } else { (2 | symbol & 1) << lower };
        all[symbol] = (first as u8, lower as u8);
        symbol += 1;
    }
    all
};

/// Codes a number near 0 whose size is about that of its context.
#[inline(always)]
pub(crate) fn code_error<K: BitCoder>(
    coder: &mut K,
    contexts: &mut [AdaptiveSymbols],
    context: usize,
    error: i64,
) -> i64 {
    let noise = (context.saturating_sub(NOISE) / 2) as u32;
    let whole = (error << 1 ^ error >> 63) as u64;
    let upper = whole >> noise;
    // Up to 4 each has a symbol; then there are two per doubling, and lower bits; the last is all that is larger.
    let symbol = if upper < 4 {
        upper as usize
    } else {
        let bits = 63 - upper.leading_zeros();
        (2 * bits as usize + (upper >> (bits - 1) & 1) as usize).min(15)
    };
    let symbol = coder.symbol(&mut contexts[context], symbol);
    if symbol == 15 {
        let upper = coder.number(upper);
        return unfold(upper.wrapping_shl(noise) | coder.raw(whole & ((1 << noise) - 1), noise));
    }
    let (first, lower) = FIRST_OF[symbol];
    let bits = u32::from(lower) + noise;
    unfold((u64::from(first) << noise) + coder.raw(whole & ((1 << bits) - 1), bits))
}

/// The number of a whole one that has the sign in its lowest bit.
#[inline(always)]
fn unfold(whole: u64) -> i64 {
    (whole >> 1) as i64 ^ -((whole & 1) as i64)
}

/// Codes a small sum.
#[inline(always)]
fn code_sum<K: BitCoder>(coder: &mut K, contexts: &mut [AdaptiveSymbols], context: usize, sum: i64) -> i64 {
    let symbol = Some(sum.wrapping_add(NO_SUM)).filter(|symbol| (1..16).contains(symbol)).unwrap_or(0);
    match coder.symbol(&mut contexts[context], symbol as usize) {
        0 => unfold(coder.number((sum << 1 ^ sum >> 63) as u64)),
        symbol => symbol as i64 - NO_SUM,
    }
}

/// How a child is coded: by its error in one of [`SIZES`] contexts, from [`BY_SUM`] on by the sum of siblings, or not at all, if it is as its
/// parent.
const BY_SUM: u8 = SIZES as u8;
const NOT_AT_ALL: u8 = u8::MAX;
const _: () = assert!(SIZES + SUMS * SUM_SIZES < NOT_AT_ALL as usize);

/// Codes the children of levels.
struct LevelCoder<'c, T> {
    contexts: &'c mut PlaneContexts,
    planes: &'static [Plane],
    has_sums: bool,
    /// By how much each child of a plane is expected to differ from its parent, in parts of 64.
    expected: Vec<T>,
    how: Vec<u8>,
    /// By how much it does.
    changes: Vec<T>,
}

impl<T: Whole> LevelCoder<'_, T> {
    /// Codes the children of a level: `children` has those to be written, and gets those that are read. Which of them are VOID
    /// the bits of `void` tell, of each parent; those are as their parents.
    fn level<K: BitCoder>(
        &mut self,
        coder: &mut K,
        parents: &Grid<T>,
        children: &mut Grid<T>,
        void: Option<&[u8]>,
    ) {
        let (side, planes) = (parents.side, self.planes);
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
            if self.has_sums && number + 1 == planes.len() {
                self.foretell_sums(&others, void);
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
            self.code(coder, number, &others);
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

    /// Codes the changes of a plane.
    #[inline(never)]
    fn code<K: BitCoder>(&mut self, coder: &mut K, plane: usize, others: &[T]) {
        let errors = &mut self.contexts.errors[plane * SIZES..][..SIZES];
        let sums = &mut self.contexts.sums[..];
        let (how, expected, changes) = (&self.how[..], &self.expected[..], &mut self.changes[..]);
        coder.many(|coder| {
            let all = changes.iter_mut().zip(expected).zip(how).zip(others);
            for (((change, expected), how), others) in all {
                if *how < BY_SUM {
                    let expected = expected.add(T::from_i64(32)).down(6);
                    let error = change.sub(expected).to_i64();
                    let error = code_error(coder, errors, usize::from(*how), error);
                    *change = T::from_i64(error).add(expected);
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

/// The channels in the order in which they are coded, and of each the one that it is told from by difference.
pub(crate) fn channel_order(form: Form) -> &'static [(usize, Option<usize>)] {
    const PLAIN: [(usize, Option<usize>); 4] = [(0, None), (1, None), (2, None), (3, None)];
    // Red and blue are much like green.
    const COLOURS: [(usize, Option<usize>); 4] = [(1, None), (0, Some(1)), (2, Some(1)), (3, None)];
    let channels = usize::from(form.value.channels);
    if channels >= 3 && is_narrow(form.value.sample) { &COLOURS[..channels] } else { &PLAIN[..channels] }
}

/// Probabilities for all channels of a segment.
pub(crate) fn plane_contexts(form: Form) -> Vec<PlaneContexts> {
    (0..form.value.channels).map(|_| PlaneContexts::new(form.children())).collect()
}

/// Codes a dense block: `block` has its bytes, or gets them, but for states and places of its record. `root` is the value of the
/// node that it begins at, if that is known.
pub(crate) fn code_block<K: BitCoder>(
    coder: &mut K,
    contexts: &mut [PlaneContexts],
    (form, rule): (Form, Rule),
    dense: Dense,
    root: &[u8],
    block: &mut [u8],
) {
    match is_narrow(form.value.sample) {
        true => code_values::<K, i32>(coder, contexts, (form, rule), dense, root, block),
        false => code_values::<K, i64>(coder, contexts, (form, rule), dense, root, block),
    }
}

fn code_values<K: BitCoder, T: Whole>(
    coder: &mut K,
    contexts: &mut [PlaneContexts],
    (form, rule): (Form, Rule),
    dense: Dense,
    root: &[u8],
    block: &mut [u8],
) {
    let (layout, sample) = (Layout::new(form), form.value.sample);
    let void = dense.has_bits().then(|| {
        let bits = &mut block[layout.dense_bits(dense.levels)..][..layout.nodes(dense.levels) / 8];
        code_mask(coder, layout.axes, dense.levels, bits);
        (dense.bottom().1 == VOID).then(|| VoidNodes::new(&layout, dense.levels, bits))
    });
    let void = void.flatten();
    let void_children = |level: u8| void.as_ref().map(|void| &void.children[usize::from(level)][..]);
    let is_void = |level: u8| void.as_ref().map(|void| &void.nodes[usize::from(level)][..]);
    let mut coded: Vec<Vec<Grid<T>>> = vec![Vec::new(); usize::from(form.value.channels)];
    for &(channel, like) in channel_order(form) {
        let from = channel * sample.size();
        let number = |bytes: &[u8]| T::from_i64(samples::read(sample, &bytes[from..]));
        let mut top = Grid::new(1, layout.axes);
        top.row_mut(0, 0)[0] = number(root);
        if let Some(like) = like {
            let other = coded[like][0].at(0, 0, [0; 3])[0];
            top.row_mut(0, 0)[0] = number(root).sub(other);
        }
        top.pad();
        let mut grids = vec![top];
        for level in 1..=dense.levels {
            let mut grid = Grid::<T>::new(1 << level, layout.axes);
            let values = layout.dense_values(level);
            if !K::READS {
                let mut bytes = block[values..].chunks_exact(layout.width);
                for_rows(1 << level, layout.axes, |_, y, z| {
                    let out = grid.row_mut(y, z);
                    out.iter_mut().zip(&mut bytes).for_each(|(out, bytes)| *out = number(bytes));
                    if let Some(like) = like {
                        let other = coded[like][usize::from(level)].at(y, z, [0; 3]);
                        out.iter_mut().zip(other).for_each(|(out, other)| *out = out.sub(*other));
                    }
                });
            }
            let mut levels = LevelCoder {
                contexts: &mut contexts[channel],
                planes: if layout.axes == 2 { &QUAD_PLANES } else { &OCT_PLANES },
                has_sums: rule == Rule::Mean,
                expected: Vec::new(),
                how: Vec::new(),
                changes: Vec::new(),
            };
            levels.level(coder, &grids[usize::from(level) - 1], &mut grid, void_children(level - 1));
            if K::READS {
                let (side, width) = (grid.side, layout.width);
                grid.each_row(|row, y, z| {
                    let bytes = &mut block[values + row * side * width + from..];
                    let numbers = grid.at(y, z, [0; 3]);
                    match like {
                        None => samples::write_all(
                            sample,
                            numbers.iter().map(|number| number.to_i64()),
                            bytes,
                            width,
                        ),
                        Some(like) => {
                            let others = coded[like][usize::from(level)].at(y, z, [0; 3]);
                            let sums =
                                numbers.iter().zip(others).map(|(number, other)| number.add(*other).to_i64());
                            samples::write_all(sample, sums, bytes, width);
                        }
                    }
                    if let Some(void) = is_void(level) {
                        let void = void[row * side..][..side].iter().zip(bytes.chunks_mut(width));
                        void.filter(|(void, _)| **void).for_each(|(_, bytes)| bytes[..sample.size()].fill(0));
                    }
                });
            }
            grid.pad();
            grids.push(grid);
        }
        coded[channel] = grids;
    }
}

/// Which nodes of a dense block are VOID, level by level.
struct VoidNodes {
    nodes: Vec<Vec<bool>>,
    /// Of each node above the bottom: a bit for each child that is VOID.
    children: Vec<Vec<u8>>,
}

impl VoidNodes {
    /// By the bits of the bottom nodes.
    fn new(layout: &Layout, levels: u8, bits: &[u8]) -> VoidNodes {
        let bottom = (0..layout.nodes(levels)).map(|at| bits[at / 8] >> (at % 8) & 1 == 0).collect();
        let mut all = VoidNodes { nodes: vec![bottom], children: Vec::new() };
        for level in (0..levels).rev() {
            let (side, below) = (1 << level, &all.nodes[all.nodes.len() - 1]);
            let mut children = vec![0; layout.nodes(level)];
            for_rows(side, layout.axes, |row, y, z| {
                let out = &mut children[row * side..][..side];
                for child in 0..layout.children {
                    let row = (2 * z + (child >> 2)) * 2 * side + 2 * y + (child >> 1 & 1);
                    let void = below[row * 2 * side..][..2 * side].iter().skip(child & 1).step_by(2);
                    out.iter_mut().zip(void).for_each(|(out, void)| *out |= u8::from(*void) << child);
                }
            });
            let whole = u8::MAX >> (8 - layout.children);
            all.nodes.push(children.iter().map(|children: &u8| *children == whole).collect());
            all.children.push(children);
        }
        all.nodes.reverse();
        all.children.reverse();
        all
    }
}

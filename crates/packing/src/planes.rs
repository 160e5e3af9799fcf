//! Dense blocks of numbers: each level coded by the one above it.
//!
//! A node's children are foretold from its own value and those of its neighbours, as if values changed evenly; where they do not, from what
//! that got wrong for the children that are known already. All first children of a level come first, as a plane of their own, then
//! all last ones, and so on: so all that foretells a plane is there when it begins, on all sides. The last plane is told by the sum of
//! siblings, which their parent knows but for its rounding, where representatives are means.

use spinney_base::Form;
use spinney_base::value::Rule;

use crate::bits::{AdaptiveSymbols, BitCoder};
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

/// Contexts of a plane by how much is expected to be wrong: two per doubling.
pub(crate) const SIZES: usize = 128;
/// Contexts of sums: by what they are expected to be, in halves from -2 to 2, and by how much is expected to be wrong.
const SUMS: usize = 9;
const SUM_SIZES: usize = 8;
/// The symbol of a sum of 0.
const NO_SUM: i64 = 8;
/// From this context on, the lower bits of what is wrong are as often set as not: one more per doubling.
const NOISE: usize = 10;

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
        let some = |count| vec![AdaptiveSymbols::default(); count];
        PlaneContexts { errors: some(children * SIZES), sums: some(SUMS * SUM_SIZES) }
    }
}

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
    let of = |upper: u64| {
        if upper < 4 {
            return (upper as usize, 0);
        }
        let bits = 63 - upper.leading_zeros();
        (2 * bits as usize + (upper >> (bits - 1) & 1) as usize, bits - 1)
    };
    let (symbol, _) = of(upper);
    let symbol = coder.symbol(&mut contexts[context], symbol.min(15));
    let upper = match symbol {
        0..4 => symbol as u64,
        15 => coder.number(upper),
        _ => {
            let lower = symbol as u32 / 2 - 1;
            let first = (2 | symbol as u64 & 1) << lower;
            first | u64::from(coder.short(upper as u32 & ((1 << lower) - 1), lower))
        }
    };
    let lower = coder.raw(whole & ((1 << noise) - 1), noise);
    let whole = upper.wrapping_shl(noise) | lower;
    (whole >> 1) as i64 ^ -((whole & 1) as i64)
}

/// Codes a block's numbers, level by level.
struct Coder<'c, K, T> {
    coder: &'c mut K,
    contexts: &'c mut PlaneContexts,
    planes: &'static [Plane],
    has_sums: bool,
    rows: Rows<T>,
}

/// Rows that are used again and again.
struct Rows<T> {
    expected: Vec<T>,
    sizes: Vec<u64>,
}

impl<K: BitCoder, T: Whole> Coder<'_, K, T> {
    /// Codes the children of a level: `children` has those to be written, and gets those that are read. Which of them are VOID
    /// `void` tells; those are as their parents.
    fn level(&mut self, parents: &Grid<T>, children: &mut Grid<T>, void: Option<&[bool]>) {
        let side = parents.side;
        let slopes = Slopes::new(parents);
        let mut wrong: Vec<Grid<T>> = (0..self.planes.len()).map(|_| Grid::new(0, parents.axes)).collect();
        for (number, plane) in self.planes.iter().enumerate() {
            let mut here = Grid::new(side, parents.axes);
            let steps = [plane.child & 1, plane.child >> 1 & 1, plane.child >> 2];
            let is_last = number + 1 == self.planes.len();
            for (row, (z, y)) in (0..parents.depth()).flat_map(|z| (0..side).map(move |y| (z, y))).enumerate() {
                let slope = slopes.row(row, plane.child);
                self.foretell(plane, &wrong, &slopes, (row, y, z));
                let parent = parents.at(y, z, [0; 3]);
                let start = children.row(2 * y + steps[1], 2 * z + steps[2], [steps[0] as isize, 0, 0]);
                let out = here.row_mut(y, z);
                for x in 0..side {
                    let is_void = |child: usize| {
                        void.is_some_and(|void| {
                            let at = [x, y, z];
                            let [x, y, z]: [usize; 3] =
                                std::array::from_fn(|axis| 2 * at[axis] + (child >> axis & 1));
                            void[(z * 2 * side + y) * 2 * side + x]
                        })
                    };
                    let at = start + 2 * x;
                    let mut change = T::default();
                    if !is_void(plane.child) {
                        let expected = slope(x).add(self.rows.expected[x].down(4));
                        let size = size_context(self.rows.sizes[x]);
                        let truth = children.values[at].sub(parent[x]);
                        let is_whole = void.is_none() || !(0..self.planes.len()).any(is_void);
                        change = if is_last && self.has_sums && is_whole {
                            let others = self.planes[..number].iter().fold(T::default(), |sum, plane| {
                                let steps = [plane.child & 1, plane.child >> 1 & 1, plane.child >> 2];
                                let row = children.row(2 * y + steps[1], 2 * z + steps[2], [0; 3]);
                                sum.add(children.values[row + 2 * x + steps[0]].sub(parent[x]))
                            });
                            let expected = expected.add(others.times(64));
                            self.sum(expected, size, truth.add(others)).sub(others)
                        } else {
                            let expected = expected.add(T::from_i64(32)).down(6);
                            let contexts = &mut self.contexts.errors[number * SIZES..][..SIZES];
                            let error = truth.sub(expected).to_i64();
                            T::from_i64(code_error(self.coder, contexts, size, error)).add(expected)
                        };
                    }
                    children.values[at] = parent[x].add(change);
                    out[x] = change.times(64).sub(slope(x));
                }
            }
            here.pad();
            wrong[plane.child] = here;
        }
    }

    /// What a row of a plane is expected to be wrong by, and how much that may be wrong by.
    fn foretell(
        &mut self,
        plane: &Plane,
        wrong: &[Grid<T>],
        slopes: &Slopes<T>,
        (row, y, z): (usize, usize, usize),
    ) {
        let Rows { expected, sizes } = &mut self.rows;
        let side = slopes.side;
        expected.clear();
        expected.resize(side, T::default());
        let mut apart: Vec<T::Size> = vec![Default::default(); side];
        let own = plane.own.iter().map(|(child, weight)| (*child, [0; 3], *weight, plane.own_size));
        let near = plane.near.iter().map(|(child, step, weight)| (*child, *step, *weight, NEAR_SIZE));
        for (child, step, weight, size) in own.chain(near) {
            let others = wrong[child].at(y, z, step);
            for ((expected, apart), other) in expected.iter_mut().zip(&mut apart).zip(others) {
                *expected = expected.add(other.times(weight));
                *apart = T::grow(*apart, other.size(), size);
            }
        }
        sizes.clear();
        let base = &slopes.sizes[row * side..][..side];
        sizes.extend(apart.iter().zip(base).map(|(apart, base)| T::to_u64(T::grow(T::shrink(*apart, 6), *base, 1))));
    }

    /// Codes the sum of what siblings differ from their parent.
    fn sum(&mut self, expected: T, size: usize, sum: T) -> T {
        let most = (SUMS / 2) as i64;
        let halves = expected.add(T::from_i64(16)).down(5).to_i64().clamp(-most, most) + most;
        let context = halves as usize * SUM_SIZES + (size / 2).clamp(1, SUM_SIZES) - 1;
        let sum = sum.to_i64();
        let symbol = Some(sum.wrapping_add(NO_SUM)).filter(|symbol| (1..16).contains(symbol)).unwrap_or(0);
        match self.coder.symbol(&mut self.contexts.sums[context], symbol as usize) {
            0 => {
                let whole = self.coder.number((sum << 1 ^ sum >> 63) as u64);
                T::from_i64((whole >> 1) as i64 ^ -((whole & 1) as i64))
            }
            symbol => T::from_i64(symbol as i64 - NO_SUM),
        }
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
        for (row, (z, y)) in (0..parents.depth()).flat_map(|z| (0..side).map(move |y| (z, y))).enumerate() {
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
                let corners = [[1, 1, 0], [-1, 1, 0], [1, -1, 0], [-1, -1, 0]].map(|step| parents.at(y, z, step));
                let across = &mut slopes.across[here];
                for x in 0..side {
                    let [a, b, c, d] = corners.map(|row| row[x].sub(own[x]));
                    across[x] = a.sub(b).sub(c).add(d);
                    let all = [a, b, c, d].iter().fold(T::Size::default(), |sum, it| T::grow(sum, it.size(), 1));
                    sizes[x] = T::grow(sizes[x], T::shrink(all, 1), 1);
                }
            }
        }
        slopes
    }

    /// By how much a child differs from its parent in parts of 64, if values change evenly: of all nodes of a row.
    #[inline(always)]
    fn row(&self, row: usize, child: usize) -> impl Fn(usize) -> T {
        let start = row * self.side;
        let sign = move |axis: usize| if child >> axis & 1 == 1 { 1 } else { -1 };
        move |x: usize| {
            let at = start + x;
            let mut change = T::default();
            for (axis, along) in self.along.iter().enumerate() {
                if !along.is_empty() {
                    change = change.add(along[at].times(8 * sign(axis)));
                }
            }
            if !self.across.is_empty() {
                change = change.add(self.across[at].times(sign(0) * sign(1)));
            }
            change
        }
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
        (dense.bottom().1 == VOID).then(|| void_levels(&layout, dense.levels, bits))
    });
    let void = void.flatten();
    let void = |level: u8| void.as_ref().map(|levels| &levels[usize::from(level)][..]);
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
            let rows = |grid: &Grid<T>| {
                let (side, depth) = (grid.side, grid.depth());
                (0..depth).flat_map(move |z| (0..side).map(move |y| (y, z))).enumerate()
            };
            let bytes = block[values..].chunks_exact(layout.width);
            if !K::READS {
                let mut bytes = bytes;
                for (_, (y, z)) in rows(&grid) {
                    let start = grid.row(y, z, [0; 3]);
                    let side = grid.side;
                    let out = &mut grid.values[start..start + side];
                    out.iter_mut().zip(&mut bytes).for_each(|(out, bytes)| *out = number(bytes));
                    if let Some(like) = like {
                        let other = coded[like][usize::from(level)].at(y, z, [0; 3]);
                        out.iter_mut().zip(other).for_each(|(out, other)| *out = out.sub(*other));
                    }
                }
            }
            let mut levels = Coder {
                coder: &mut *coder,
                contexts: &mut contexts[channel],
                planes: if layout.axes == 2 { &QUAD_PLANES } else { &OCT_PLANES },
                has_sums: rule == Rule::Mean,
                rows: Rows { expected: Vec::new(), sizes: Vec::new() },
            };
            levels.level(&grids[usize::from(level) - 1], &mut grid, void(level));
            if K::READS {
                let mut bytes = block[values..].chunks_exact_mut(layout.width);
                for (row, (y, z)) in rows(&grid) {
                    for (x, number) in grid.at(y, z, [0; 3]).iter().enumerate() {
                        let Some(bytes) = bytes.next() else { break };
                        if void(level).is_some_and(|void| void[row * grid.side + x]) {
                            continue;
                        }
                        let other = like.map(|like| coded[like][usize::from(level)].at(y, z, [0; 3])[x]);
                        let number = number.add(other.unwrap_or_default());
                        samples::write(sample, number.to_i64(), &mut bytes[from..]);
                    }
                }
            }
            grid.pad();
            grids.push(grid);
        }
        coded[channel] = grids;
    }
}

/// Which nodes of each level are VOID, by the bits of the bottom nodes.
fn void_levels(layout: &Layout, levels: u8, bits: &[u8]) -> Vec<Vec<bool>> {
    let bottom = (0..layout.nodes(levels)).map(|at| bits[at / 8] >> (at % 8) & 1 == 0).collect();
    let mut all = vec![bottom];
    for level in (0..levels).rev() {
        let below: &Vec<bool> = &all[all.len() - 1];
        let is_void = |at| (0..layout.children).all(|child| below[layout.dense_child(level + 1, at, child)]);
        let here = (0..layout.nodes(level)).map(is_void).collect();
        all.push(here);
    }
    all.reverse();
    all
}

//! Predictions of the nodes of a level from the level above and from planes of the same level that are finished.
//!
//! A plane is the same child of all nodes of a level. All that predicts a plane, and its contexts, is there when it begins: so both are computed
//! row by row, as vectors.

use crate::contexts::Contexts;
use crate::grids::{Grid, rows};
use crate::lanes::Lane;
use crate::vectorized::vectorized;

/// A child of a neighbour, and the step to its parent.
type NearChild = (usize, [isize; 3]);

/// A plane of children, and what predicts it.
pub(crate) struct Plane {
    pub(crate) child: usize,
    /// Siblings whose errors of interpolation count, and their weights at first, in 16ths.
    own: &'static [(usize, i8)],
    /// Children of neighbours, which are pairs or single ones with one weight each.
    near: &'static [(&'static [NearChild], i8)],
    /// Bits by which errors of siblings are enlarged as sizes of what may be wrong.
    own_size: u32,
}

/// Bits by which errors of neighbours' children are enlarged as sizes.
const NEAR_SIZE: u32 = 2;

const QUAD_PLANES: [Plane; 4] = [
    Plane { child: 0, own: &[], near: &[], own_size: 0 },
    Plane {
        child: 3,
        own: &[(0, -12)],
        near: &[(&[(0, [1, 0, 0]), (0, [0, 1, 0])], 0), (&[(0, [1, 1, 0])], 0)],
        own_size: 5,
    },
    Plane {
        child: 1,
        own: &[(0, -4), (3, -8)],
        near: &[(&[(0, [1, 0, 0]), (3, [0, -1, 0])], 2), (&[(0, [0, 1, 0]), (3, [-1, 0, 0])], 0)],
        own_size: 4,
    },
    Plane {
        child: 2,
        own: &[(0, -8), (3, -8), (1, -11)],
        near: &[(&[(0, [0, 1, 0]), (3, [-1, 0, 0])], 1)],
        own_size: 3,
    },
];

const OCT_PLANES: [Plane; 8] = [
    Plane { child: 0, own: &[], near: &[], own_size: 0 },
    Plane { child: 7, own: &[(0, -12)], near: &[(&[(0, [1, 1, 1])], 0)], own_size: 5 },
    Plane { child: 1, own: &[(0, 1), (7, -3)], near: &[(&[(0, [1, 0, 0])], 2)], own_size: 4 },
    Plane { child: 6, own: &[(1, -10), (7, 1)], near: &[(&[(7, [-1, 0, 0])], 2)], own_size: 3 },
    Plane { child: 2, own: &[(0, 1), (7, -1), (6, 1)], near: &[(&[(0, [0, 1, 0])], 2)], own_size: 3 },
    Plane { child: 5, own: &[(2, -10), (7, 1)], near: &[(&[(7, [0, -1, 0])], 2)], own_size: 3 },
    Plane {
        child: 3,
        own: &[(7, 4), (1, 4), (2, 4), (0, -4), (6, -4), (5, -4)],
        near: &[(&[(7, [0, 0, -1])], 2)],
        own_size: 3,
    },
    Plane {
        child: 4,
        own: &[(3, -11), (0, -2), (7, -2), (1, -2), (6, -2), (2, -2), (5, -2)],
        near: &[(&[(0, [0, 0, 1])], 1)],
        own_size: 2,
    },
];

/// The planes of trees with so many axes, in the order in which they are coded.
pub(crate) fn planes(axes: usize) -> &'static [Plane] {
    if axes == 2 { &QUAD_PLANES } else { &OCT_PLANES }
}

/// Features of a plane at most.
pub(crate) const MAX_FEATURES: usize = 16;
/// Weights of the features of planes, in 16ths.
pub(crate) type Weights = [[i8; MAX_FEATURES]; 8];

impl Plane {
    /// How many features predict it: slopes, how they change across (in quadtrees), curvatures, siblings, neighbours' children.
    pub(crate) fn features(&self, axes: usize) -> usize {
        2 * axes + usize::from(axes == 2) + self.own.len() + self.near.len()
    }
}

/// Weights where none are stored: values change evenly, but for what was wrong about others.
pub(crate) fn default_weights(axes: usize) -> Weights {
    let mut all = [[0; MAX_FEATURES]; 8];
    for (plane, weights) in planes(axes).iter().zip(&mut all) {
        let sign = |axis: usize| if plane.child >> axis & 1 == 1 { 1 } else { -1 };
        let slopes = (0..axes).map(|axis| 16 * sign(axis));
        let across = (axes == 2).then(|| 16 * sign(0) * sign(1));
        let curved = (0..axes).map(|_| 0);
        let others =
            plane.own.iter().map(|(_, weight)| *weight).chain(plane.near.iter().map(|(_, weight)| *weight));
        let features = slopes.chain(across).chain(curved).chain(others);
        weights.iter_mut().zip(features).for_each(|(weight, feature)| *weight = feature);
    }
    all
}

/// What predicts a channel.
#[derive(Clone, Copy)]
pub(crate) struct Predictor {
    /// Fraction bits of features: at least [`MIN_FRACTION`].
    pub(crate) fraction: u32,
    pub(crate) weights: Weights,
}

/// Features have at least so many fraction bits, and predictions so many fewer than features.
pub(crate) const MIN_FRACTION: u32 = 2;
pub(crate) const MAX_FRACTION: u32 = 6;

/// Numbers of all nodes of a level: of a grid with its border, moved by some numbers, or without.
#[derive(Clone, Copy)]
struct Rows<'t, T> {
    numbers: &'t [T],
    moved: Option<isize>,
}

impl<'t, T: Lane> Rows<'t, T> {
    const NONE: Rows<'static, T> = Rows { numbers: &[], moved: None };

    /// Some numbers of a row, whose first index is given for both.
    #[inline(always)]
    fn some<const N: usize>(&self, [plain, bordered]: [usize; 2]) -> Option<&'t [T; N]> {
        let start = self.moved.map_or(plain, |by| bordered.wrapping_add_signed(by));
        self.numbers.get(start..start + N)?.first_chunk()
    }

    /// A row.
    fn row(&self, [plain, bordered]: [usize; 2], side: usize) -> &'t [T] {
        let start = self.moved.map_or(plain, |by| bordered.wrapping_add_signed(by));
        &self.numbers[start..start + side]
    }
}

/// Features and their weights, but for those without any; of pairs of neighbours' children each is one.
struct Terms<'t, T> {
    terms: [(Rows<'t, T>, T); MAX_FEATURES],
    count: usize,
    /// How many there are with those without any weight.
    all: usize,
}

/// Errors that sizes are made of.
struct Sizes<'t, T> {
    uneven: &'t [T],
    own: [Rows<'t, T>; 8],
    owns: usize,
    near: [Rows<'t, T>; 4],
    nears: usize,
    /// Bits by which own ones, and those near, are shifted to the left, then to the right.
    own_shift: (u32, u32),
    near_shift: (u32, u32),
}

/// Samples of a row that are computed together.
const CHUNK: usize = 16;

impl<T: Lane> Terms<'_, T> {
    /// Sums of the products of some samples of a row.
    #[inline(always)]
    fn sums<const N: usize>(&self, at: [usize; 2]) -> [T; N] {
        let mut sums = [T::default(); N];
        for (rows, weight) in &self.terms[..self.count] {
            let Some(row) = rows.some::<N>(at) else { continue };
            for (sum, number) in sums.iter_mut().zip(row) {
                *sum = sum.plus(number.times(*weight));
            }
        }
        sums
    }
}

impl<T: Lane> Sizes<'_, T> {
    /// Sizes of what may be wrong about some samples of a row.
    #[inline(always)]
    fn sizes<const N: usize>(&self, at: [usize; 2]) -> [T; N] {
        let sum = |all: &[Rows<'_, T>], (left, right): (u32, u32)| {
            let mut sums = [T::default(); N];
            for rows in all {
                let Some(row) = rows.some::<N>(at) else { continue };
                for (sum, number) in sums.iter_mut().zip(row) {
                    *sum = sum.add_size(number.size());
                }
            }
            sums.map(|sum| sum.grow_size(left).right(right))
        };
        let own = sum(&self.own[..self.owns], self.own_shift);
        let near = sum(&self.near[..self.nears], self.near_shift);
        let mut sizes = [T::default(); N];
        if let Some(uneven) = self.uneven.get(at[0]..at[0] + N) {
            for ((size, uneven), (own, near)) in sizes.iter_mut().zip(uneven).zip(own.iter().zip(&near)) {
                *size = uneven.add_size(*own).add_size(*near);
            }
        }
        sizes
    }
}

/// The rows of a level that are predicted.
#[derive(Clone, Copy)]
struct Shape {
    side: usize,
    axes: usize,
    /// Of each so many rows one, from a number on.
    step: usize,
}

/// Calls for each chunk of all rows, and for each sample after these, with its index, and that in a grid with its border.
macro_rules! in_chunks {
    ($shape:expr, |$at:ident| $chunk:block, $one:block) => {
        let Shape { side, axes, step } = $shape;
        let wide = side + 2;
        let mut number = 0;
        for z in 0..if axes == 3 { side } else { 1 } {
            for y in 0..side {
                let row = number * side;
                number += 1;
                if !is_wanted([y, z], step) {
                    continue;
                }
                let bordered = ((if axes == 3 { z + 1 } else { 0 }) * wide + y + 1) * wide + 1;
                let mut x = 0;
                while x + CHUNK <= side {
                    let $at = [row + x, bordered + x];
                    $chunk
                    x += CHUNK;
                }
                while x < side {
                    let $at = [row + x, bordered + x];
                    $one
                    x += 1;
                }
            }
        }
    };
}

/// Some numbers from a place on.
#[inline(always)]
fn chunk_mut<N, const C: usize>(numbers: &mut [N], at: usize) -> Option<&mut [N; C]> {
    numbers.get_mut(at..at + C)?.first_chunk_mut()
}

vectorized! {
    /// Predicts differences from parents, and the contexts of errors.
    fn errors | errors_baseline | errors_avx2 <T>(
        terms: &Terms<'_, T>,
        sizes: &Sizes<'_, T>,
        shape: Shape,
        how: (bool, u32, T),
        expected: &mut [T],
        contexts: &mut [u8]
    ) {
        let (is_first, shift, round) = how;
        let base = Contexts::<T>::error(is_first, 0);
        macro_rules! some {
            ($count:expr, $at:ident) => {{
                let (sums, sizes) = (terms.sums::<{ $count }>($at), sizes.sizes::<{ $count }>($at));
                if let (Some(expected), Some(contexts)) =
                    (chunk_mut::<_, { $count }>(expected, $at[0]), chunk_mut::<_, { $count }>(contexts, $at[0]))
                {
                    for x in 0..$count {
                        expected[x] = sums[x].plus(round).right(shift);
                        contexts[x] = base + sizes[x].size_bits();
                    }
                }
            }};
        }
        in_chunks!(shape, |at| { some!(CHUNK, at) }, { some!(1, at) });
    }
}

vectorized! {
    /// Predicts sums of differences from parents: what is expected makes the sum 0, and the context says what it will be.
    fn sums | sums_baseline | sums_avx2 <T>(
        terms: &Terms<'_, T>,
        sizes: &Sizes<'_, T>,
        shape: Shape,
        how: (u32, T),
        others: &[T],
        expected: &mut [T],
        contexts: &mut [u8]
    ) {
        let (shift, round) = how;
        macro_rules! some {
            ($count:expr, $at:ident) => {{
                let (sums, sizes) = (terms.sums::<{ $count }>($at), sizes.sizes::<{ $count }>($at));
                let others = others.get($at[0]..).and_then(|others| others.first_chunk::<{ $count }>());
                if let (Some(expected), Some(contexts), Some(others)) = (
                    chunk_mut::<_, { $count }>(expected, $at[0]),
                    chunk_mut::<_, { $count }>(contexts, $at[0]),
                    others,
                ) {
                    for x in 0..$count {
                        let sum = others[x].left(shift).plus(sums[x]).plus(round).left(1).right(shift);
                        expected[x] = T::default().minus(others[x]);
                        contexts[x] = Contexts::<T>::sum(sum.within_4(), sizes[x].size_bits());
                    }
                }
            }};
        }
        in_chunks!(shape, |at| { some!(CHUNK, at) }, { some!(1, at) });
    }
}

vectorized! {
    /// Slopes of a row along an axis, in parts of 2^fraction by child, curvatures, and how uneven it is there.
    fn slope_row | slope_row_baseline | slope_row_avx2<T>(
        fraction: u32,
        rows: [&[T]; 3],
        slopes: &mut [T],
        curved: &mut [T],
        uneven: &mut [T],
    ) {
        let [before, own, after] = rows;
    let width = own.len();
    let (before, after) = (&before[..width], &after[..width]);
    let (slopes, curved, uneven) = (&mut slopes[..width], &mut curved[..width], &mut uneven[..width]);
    // (An eighth: a child is a quarter of a cell away, and the difference is that of two cells.)
    let (left, right) = (fraction.saturating_sub(3), 3u32.saturating_sub(fraction));
    for x in 0..width {
        let (up, down) = (after[x].minus(own[x]), own[x].minus(before[x]));
        let bend = up.minus(down);
        slopes[x] = up.plus(down).left(left).right(right);
        curved[x] = bend.left(left).right(right);
        let bent = bend.size();
        uneven[x] = uneven[x].add_size(up.size().add_size(down.size()).add_size(bent.add_size(bent)));
    }
    }
}

/// How slopes of a row along one axis change along the other.
#[inline(never)]
fn across_row<T: Lane>(fraction: u32, corners: [&[T]; 4], across: &mut [T]) {
    let [nw, ne, sw, se] = corners.map(|row| &row[..across.len()]);
    for (x, across) in across.iter_mut().enumerate() {
        *across = se[x].minus(sw[x]).minus(ne[x]).plus(nw[x]).right(6 - fraction.min(6));
    }
}

vectorized! {
    /// What is wrong about interpolated differences of a row, in parts of 2^fraction.
    fn wrong_row | wrong_row_baseline | wrong_row_avx2<T>(
        fraction: u32,
        slopes: &[(&[T], bool)],
        changes: &[T],
        wrong: &mut [T],
    ) {
    let width = changes.len();
    let wrong = &mut wrong[..width];
    for x in 0..width {
        wrong[x] = changes[x].left(fraction);
    }
    for (row, is_less) in slopes {
        let row = &row[..width];
        if *is_less {
            for x in 0..width {
                wrong[x] = wrong[x].plus(row[x]);
            }
        } else {
            for x in 0..width {
                wrong[x] = wrong[x].minus(row[x]);
            }
        }
    }
    }
}

/// A level that is coded, and what predicts it.
#[derive(Default)]
pub(crate) struct Level<T> {
    pub(crate) side: usize,
    axes: usize,
    fraction: u32,
    /// Of each parent: slopes along the axes, how they change across, curvatures, and how uneven it is.
    slopes: [Vec<T>; 3],
    across: Vec<T>,
    curved: [Vec<T>; 3],
    uneven: Vec<T>,
    /// What is wrong about children, by child.
    wrong: [Grid<T>; 8],
    /// Sums of the differences of finished planes.
    pub(crate) others: Vec<T>,
    /// What the plane is expected to differ from its parents, and contexts.
    pub(crate) expected: Vec<T>,
    pub(crate) contexts: Vec<u8>,
    /// Differences from the parents, by child.
    pub(crate) changes: [Vec<T>; 8],
}

fn grow<T: Clone + Default>(numbers: &mut Vec<T>, room: usize) {
    if numbers.len() < room {
        numbers.resize(room, T::default());
    }
}

impl<T: Lane> Level<T> {
    /// Begins with a level below some parents.
    pub(crate) fn begin(&mut self, fraction: u32, parents: &Grid<T>) {
        let (side, axes) = (parents.side, parents.axes);
        (self.side, self.axes, self.fraction) = (side, axes, fraction);
        let nodes = side.pow(axes as u32);
        for numbers in self.slopes[..axes].iter_mut().chain(&mut self.curved[..axes]) {
            grow(numbers, nodes);
        }
        for numbers in [&mut self.across, &mut self.uneven, &mut self.others, &mut self.expected] {
            grow(numbers, nodes);
        }
        self.changes[..1 << axes].iter_mut().for_each(|changes| grow(changes, nodes));
        grow(&mut self.contexts, nodes);
        self.uneven[..nodes].fill(T::default());
        self.others[..nodes].fill(T::default());
        for wrong in &mut self.wrong[..1 << axes] {
            wrong.reset(side, axes);
        }
        for (number, row) in rows(side, axes).enumerate() {
            let nodes = number * side..(number + 1) * side;
            let own = parents.row(row, [0; 3]);
            for axis in 0..axes {
                let mut step = [0; 3];
                step[axis] = 1;
                let after = parents.row(row, step);
                step[axis] = -1;
                let before = parents.row(row, step);
                slope_row(
                    fraction,
                    [before, own, after],
                    &mut self.slopes[axis][nodes.clone()],
                    &mut self.curved[axis][nodes.clone()],
                    &mut self.uneven[nodes.clone()],
                );
            }
            if axes == 2 {
                let corners =
                    [[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]].map(|step| parents.row(row, step));
                across_row(fraction, corners, &mut self.across[nodes]);
            }
        }
    }

    /// The features of a plane (pairs are two), and what sizes are made of.
    fn terms<'t>(&'t self, plane: &Plane, weights: &[i8]) -> (Terms<'t, T>, Sizes<'t, T>) {
        let mut terms = Terms { terms: [(Rows::NONE, T::default()); MAX_FEATURES], count: 0, all: 0 };
        let mut weights = weights.iter().map(|weight| T::weight(*weight));
        let mut weight = || weights.next().unwrap_or_default();
        let mut push = |rows: Rows<'t, T>, weight: T| {
            terms.terms[terms.count] = (rows, weight);
            terms.count += usize::from(weight != T::default());
            terms.all += 1;
        };
        let plain = |numbers: &'t [T]| Rows { numbers, moved: None };
        for slopes in &self.slopes[..self.axes] {
            push(plain(slopes), weight());
        }
        if self.axes == 2 {
            push(plain(&self.across), weight());
        }
        for curved in &self.curved[..self.axes] {
            push(plain(curved), weight());
        }
        let shift = |bits: u32| (bits.saturating_sub(self.fraction), self.fraction.saturating_sub(bits));
        let mut sizes = Sizes {
            uneven: &self.uneven,
            own: [Rows::NONE; 8],
            owns: plane.own.len(),
            near: [Rows::NONE; 4],
            nears: 0,
            own_shift: shift(plane.own_size),
            near_shift: shift(NEAR_SIZE),
        };
        let moved = |child: usize, step: [isize; 3]| {
            let wide = self.side as isize + 2;
            let by = (step[2] * wide + step[1]) * wide + step[0];
            Rows { numbers: self.wrong[child].numbers(), moved: Some(by) }
        };
        for ((child, _), own) in plane.own.iter().zip(&mut sizes.own) {
            *own = moved(*child, [0; 3]);
            push(*own, weight());
        }
        for (rows, _) in plane.near {
            let weight = weight();
            for (child, step) in *rows {
                let near = moved(*child, *step);
                push(near, weight);
                sizes.near[sizes.nears] = near;
                sizes.nears += 1;
            }
        }
        (terms, sizes)
    }

    /// Predicts a plane: fills what is expected, and contexts. `is_sum` says that sums of siblings are coded.
    pub(crate) fn predict(&mut self, number: usize, weights: &Weights, is_sum: bool) {
        self.predict_rows(number, weights, is_sum, 1);
    }

    /// Predicts one of so many rows of a plane: see [`is_wanted`].
    pub(crate) fn predict_rows(&mut self, number: usize, weights: &Weights, is_sum: bool, step: usize) {
        let plane = &planes(self.axes)[number];
        let (mut expected, mut contexts) =
            (std::mem::take(&mut self.expected), std::mem::take(&mut self.contexts));
        let (terms, sizes) = self.terms(plane, &weights[number]);
        let shape = Shape { side: self.side, axes: self.axes, step };
        let shift = self.fraction - MIN_FRACTION;
        // (Half, and half of each product, as these are rounded down.)
        let half = |bits: u32| T::from_i64((1 << bits >> 1) + terms.all as i64 / 2);
        if is_sum {
            let how = (shift, half(shift.saturating_sub(1)));
            sums(&terms, &sizes, shape, how, &self.others, &mut expected, &mut contexts);
        } else {
            let how = (number == 0, shift, half(shift));
            errors(&terms, &sizes, shape, how, &mut expected, &mut contexts);
        }
        (self.expected, self.contexts) = (expected, contexts);
    }

    /// Finishes a plane whose changes are known.
    pub(crate) fn finish(&mut self, number: usize) {
        let planes = planes(self.axes);
        let child = planes[number].child;
        let nodes = self.side.pow(self.axes as u32);
        add(&mut self.others[..nodes], &self.changes[child][..nodes]);
        if number + 1 == planes.len() {
            return;
        }
        let mut wrong = std::mem::take(&mut self.wrong[child]);
        for (index, row) in rows(self.side, self.axes).enumerate() {
            let nodes = index * self.side..(index + 1) * self.side;
            let mut slopes = [(&[][..], false); 4];
            let is_lower = |axis: usize| child >> axis & 1 == 0;
            for (axis, slope) in slopes[..self.axes].iter_mut().enumerate() {
                *slope = (&self.slopes[axis][nodes.clone()], is_lower(axis));
            }
            let count = if self.axes == 2 {
                slopes[2] = (&self.across[nodes.clone()], is_lower(0) != is_lower(1));
                3
            } else {
                self.axes
            };
            wrong_row(self.fraction, &slopes[..count], &self.changes[child][nodes], wrong.row_mut(row));
        }
        wrong.pad();
        self.wrong[child] = wrong;
    }

    /// Puts the children together.
    pub(crate) fn children(&self, parents: &Grid<T>, children: &mut Grid<T>) {
        children.reset(2 * self.side, self.axes);
        for (index, [y, z]) in rows(self.side, self.axes).enumerate() {
            let nodes = index * self.side..(index + 1) * self.side;
            let parents = parents.row([y, z], [0; 3]);
            for pair in 0..1 << (self.axes - 1) {
                let [first, second] = [0, 1].map(|x| &self.changes[2 * pair + x][nodes.clone()]);
                let to = children.row_mut([2 * y + (pair & 1), 2 * z + (pair >> 1)]);
                join(parents, first, second, to);
            }
        }
        children.pad();
    }

    /// Takes the differences of children from their parents.
    pub(crate) fn take(&mut self, parents: &Grid<T>, children: &Grid<T>) {
        (self.side, self.axes) = (parents.side, parents.axes);
        let nodes = parents.side.pow(parents.axes as u32);
        self.changes[..1 << parents.axes].iter_mut().for_each(|changes| grow(changes, nodes));
        for (index, [y, z]) in rows(self.side, self.axes).enumerate() {
            let nodes = index * self.side..(index + 1) * self.side;
            let parents = parents.row([y, z], [0; 3]);
            for pair in 0..1 << (self.axes - 1) {
                let from = children.row([2 * y + (pair & 1), 2 * z + (pair >> 1)], [0; 3]);
                let (first, second) = self.changes.split_at_mut(2 * pair + 1);
                part(parents, from, &mut first[2 * pair][nodes.clone()], &mut second[0][nodes.clone()]);
            }
        }
    }

    /// What the features of a row are, for fitting: of pairs the sum.
    pub(crate) fn features(&self, plane: usize, row: [usize; 2], mut each: impl FnMut(usize, &[T])) {
        let plane = &planes(self.axes)[plane];
        let (terms, sizes) = self.terms(plane, &[1; MAX_FEATURES]);
        let at = self.at(row);
        let singles = terms.count - sizes.nears;
        for (feature, (rows, _)) in terms.terms[..singles].iter().enumerate() {
            each(feature, rows.row(at, self.side));
        }
        let mut near = sizes.near[..sizes.nears].iter().map(|rows| rows.row(at, self.side));
        for (feature, (rows, _)) in (singles..).zip(plane.near) {
            match (near.next(), rows.len()) {
                (Some(one), 1) => each(feature, one),
                (one, _) => {
                    let mut sum = one.unwrap_or_default().to_vec();
                    add(&mut sum, near.next().unwrap_or_default());
                    each(feature, &sum);
                }
            }
        }
    }

    /// Indices of the first node of a row, without and with the border of grids.
    fn at(&self, [y, z]: [usize; 2]) -> [usize; 2] {
        let wide = self.side + 2;
        let plane = if self.axes == 3 { z + 1 } else { 0 };
        [(z * self.side + y) * self.side, (plane * wide + y + 1) * wide + 1]
    }

    /// Fraction bits of features.
    pub(crate) fn fraction(&self) -> u32 {
        self.fraction
    }
}

/// Whether a row by its y and z is one of those of which there is one of so many.
pub(crate) fn is_wanted([y, z]: [usize; 2], step: usize) -> bool {
    (y + z) % step == step / 2
}

fn add<T: Lane>(sums: &mut [T], numbers: &[T]) {
    for (sum, number) in sums.iter_mut().zip(numbers) {
        *sum = sum.plus(*number);
    }
}

#[inline(never)]
fn join<T: Lane>(parents: &[T], first: &[T], second: &[T], to: &mut [T]) {
    for (((to, first), second), parent) in to.chunks_exact_mut(2).zip(first).zip(second).zip(parents) {
        (to[0], to[1]) = (first.plus(*parent), second.plus(*parent));
    }
}

#[inline(never)]
fn part<T: Lane>(parents: &[T], from: &[T], first: &mut [T], second: &mut [T]) {
    for (((from, first), second), parent) in from.chunks_exact(2).zip(first).zip(second).zip(parents) {
        (*first, *second) = (from[0].minus(*parent), from[1].minus(*parent));
    }
}

//! Predictions of the nodes of a level, from the level above and from finished planes of the same
//! level.
//!
//! A plane is the same child of all nodes of a level. All predictors and contexts of a plane are
//! known before the plane starts, so they are computed row by row, in vectorized loops.

use crate::grids::{Grid, Shape};
use crate::lanes::Lane;
use crate::plane_form::{MAX_FEATURES, MIN_FRACTION, NEAR_SIZE, Plane, Weights, planes};
use crate::plane_kernels::{
    Rows, Sampled, Sizes, Terms, across_row, deviation_row, predict_differences, predict_sums, slope_row,
};

/// Level that is coded, with the inputs of its predictions.
///
/// Invariant: a writer and a reader compute the same predictions and contexts. A plane is predicted
/// only from its parents and from `changes` of earlier planes, and VOID nodes have their parent's
/// number. All arithmetic wraps, so corrupt input yields other numbers, and nothing worse.
#[derive(Default)]
pub(crate) struct Level<T> {
    pub(crate) shape: Shape,
    fraction: u32,
    /// Per parent: slopes along the axes, the mixed second difference, curvatures, and unevenness
    /// (magnitudes of differences from neighbours, and twice those of second differences: only for
    /// expected sizes).
    slopes: [Vec<T>; 3],
    across: Vec<T>,
    curved: [Vec<T>; 3],
    uneven: Vec<T>,
    /// Deviations, by child: the difference from the parent, less that by linear interpolation
    /// (slopes and mixed second difference), in units of 2^-fraction. They only predict later
    /// planes. What is coded is the residual: the difference from the parent less `expected`.
    deviations: [Grid<T>; 8],
    /// Sums of the differences of finished planes from their parents.
    pub(crate) others: Vec<T>,
    /// Expected differences of the current plane from its parents, and contexts.
    pub(crate) expected: Vec<T>,
    pub(crate) contexts: Vec<u8>,
    /// Differences from the parents, by child.
    pub(crate) changes: [Vec<T>; 8],
}

fn grow<T: Clone + Default>(numbers: &mut Vec<T>, count: usize) {
    if numbers.len() < count {
        numbers.resize(count, T::default());
    }
}

impl<T: Lane> Level<T> {
    /// Starts a level below some parents: computes slopes, curvatures and unevenness.
    pub(crate) fn begin(&mut self, fraction: u32, parents: &Grid<T>) {
        let (shape, axes) = (parents.shape, parents.shape.axes);
        (self.shape, self.fraction) = (shape, fraction);
        let (width, nodes) = (shape.width(), shape.nodes());
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
        for deviations in &mut self.deviations[..1 << axes] {
            deviations.reset(shape);
        }
        for (number, row) in shape.rows().enumerate() {
            let nodes = number * width..(number + 1) * width;
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

    /// Returns the weighted features of a plane (pairs count twice), and the inputs of expected
    /// sizes (see [`Plane::own_size`]).
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
        for slopes in &self.slopes[..self.shape.axes] {
            push(plain(slopes), weight());
        }
        if self.shape.axes == 2 {
            push(plain(&self.across), weight());
        }
        for curved in &self.curved[..self.shape.axes] {
            push(plain(curved), weight());
        }
        // (From the fraction bits of deviations to 64ths, and a weight in 64ths.)
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
            let (high, wide) = (self.shape.side as isize + 2, self.shape.width() as isize + 2);
            let by = (step[2] * high + step[1]) * wide + step[0];
            Rows { numbers: self.deviations[child].numbers(), moved: Some(by) }
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

    /// Predicts a plane: fills `expected` and `contexts`. With `is_sum`, sums of siblings are
    /// coded.
    pub(crate) fn predict(&mut self, number: usize, weights: &Weights, is_sum: bool) {
        self.predict_rows(number, weights, is_sum, 1);
    }

    /// Predicts one row in `step` of a plane: see [`is_wanted`].
    pub(crate) fn predict_rows(&mut self, number: usize, weights: &Weights, is_sum: bool, step: usize) {
        let plane = &planes(self.shape.axes)[number];
        let (mut expected, mut contexts) =
            (std::mem::take(&mut self.expected), std::mem::take(&mut self.contexts));
        let (terms, sizes) = self.terms(plane, &weights[number]);
        let rows = Sampled { shape: self.shape, step };
        let shift = self.fraction - MIN_FRACTION;
        // (Products are rounded down: adding half a unit for each of them, and for the sum,
        // corrects the bias. Features of weight 0 are counted too, although their products are
        // exact: the format defines the correction by the number of features alone.)
        let half = |bits: u32| T::from_i64((1 << bits >> 1) + terms.all as i64 / 2);
        if is_sum {
            let how = (shift, half(shift.saturating_sub(1)));
            predict_sums(&terms, &sizes, rows, how, &self.others, &mut expected, &mut contexts);
        } else {
            let how = (number == 0, shift, half(shift));
            predict_differences(&terms, &sizes, rows, how, &mut expected, &mut contexts);
        }
        (self.expected, self.contexts) = (expected, contexts);
    }

    /// Finishes a plane whose differences are known: adds them to `others`, and computes its
    /// deviations.
    pub(crate) fn finish(&mut self, number: usize) {
        let axes = self.shape.axes;
        let planes = planes(axes);
        let child = planes[number].child;
        let (width, nodes) = (self.shape.width(), self.shape.nodes());
        add(&mut self.others[..nodes], &self.changes[child][..nodes]);
        if number + 1 == planes.len() {
            return;
        }
        let mut deviations = std::mem::take(&mut self.deviations[child]);
        for (index, row) in self.shape.rows().enumerate() {
            let nodes = index * width..(index + 1) * width;
            let mut slopes = [(&[][..], false); 4];
            let is_lower = |axis: usize| child >> axis & 1 == 0;
            for (axis, slope) in slopes[..axes].iter_mut().enumerate() {
                *slope = (&self.slopes[axis][nodes.clone()], is_lower(axis));
            }
            let count = if axes == 2 {
                slopes[2] = (&self.across[nodes.clone()], is_lower(0) != is_lower(1));
                3
            } else {
                axes
            };
            deviation_row(
                self.fraction,
                &slopes[..count],
                &self.changes[child][nodes],
                deviations.row_mut(row),
            );
        }
        deviations.pad();
        self.deviations[child] = deviations;
    }

    /// Interleaves all planes into the grid of the children.
    pub(crate) fn children(&self, parents: &Grid<T>, children: &mut Grid<T>) {
        let shape = self.shape;
        children.reset(shape.below());
        for (index, [y, z]) in shape.rows().enumerate() {
            let nodes = index * shape.width()..(index + 1) * shape.width();
            let parents = parents.row([y, z], [0; 3]);
            for pair in 0..1 << (shape.axes - 1) {
                let [first, second] = [0, 1].map(|x| &self.changes[2 * pair + x][nodes.clone()]);
                let to = children.row_mut([2 * y + (pair & 1), 2 * z + (pair >> 1)]);
                let all = shape.below().blocks_mut(to).zip(shape.blocks(parents));
                for ((to, parents), changes) in all.zip(shape.blocks(first).zip(shape.blocks(second))) {
                    join(parents, changes, to);
                }
            }
        }
        children.pad();
    }

    /// Computes the differences of the children from their parents.
    pub(crate) fn take(&mut self, parents: &Grid<T>, children: &Grid<T>) {
        let shape = parents.shape;
        self.shape = shape;
        self.changes[..1 << shape.axes].iter_mut().for_each(|changes| grow(changes, shape.nodes()));
        for (index, [y, z]) in shape.rows().enumerate() {
            let nodes = index * shape.width()..(index + 1) * shape.width();
            let parents = parents.row([y, z], [0; 3]);
            for pair in 0..1 << (shape.axes - 1) {
                let from = children.row([2 * y + (pair & 1), 2 * z + (pair >> 1)], [0; 3]);
                let (first, second) = self.changes.split_at_mut(2 * pair + 1);
                let first = shape.blocks_mut(&mut first[2 * pair][nodes.clone()]);
                let second = shape.blocks_mut(&mut second[0][nodes.clone()]);
                let all = shape.below().blocks(from).zip(shape.blocks(parents));
                for ((from, parents), changes) in all.zip(first.zip(second)) {
                    part(parents, from, changes);
                }
            }
        }
    }

    /// Calls `each` with every feature of a row and its index, for fitting. A pair is one feature,
    /// the sum of both.
    pub(crate) fn features(&self, plane: usize, row: [usize; 2], mut each: impl FnMut(usize, &[T])) {
        let plane = &planes(self.shape.axes)[plane];
        let (terms, sizes) = self.terms(plane, &[1; MAX_FEATURES]);
        let at = self.at(row);
        let singles = terms.count - sizes.nears;
        for (feature, (rows, _)) in terms.terms[..singles].iter().enumerate() {
            each(feature, rows.row(at, self.shape.width()));
        }
        let mut near = sizes.near[..sizes.nears].iter().map(|rows| rows.row(at, self.shape.width()));
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

    /// Returns the index of a row's first node, in arrays without and with the border of grids.
    fn at(&self, [y, z]: [usize; 2]) -> [usize; 2] {
        let Shape { side, axes, .. } = self.shape;
        let width = self.shape.width();
        let plane = if axes == 3 { z + 1 } else { 0 };
        [(z * side + y) * width, (plane * (side + 2) + y + 1) * (width + 2) + 1]
    }

    /// Returns the number of fraction bits of features.
    pub(crate) fn fraction(&self) -> u32 {
        self.fraction
    }
}

fn add<T: Lane>(sums: &mut [T], numbers: &[T]) {
    for (sum, number) in sums.iter_mut().zip(numbers) {
        *sum = sum.plus(*number);
    }
}

#[inline(never)]
fn join<T: Lane>(parents: &[T], (first, second): (&[T], &[T]), to: &mut [T]) {
    for (((to, first), second), parent) in to.chunks_exact_mut(2).zip(first).zip(second).zip(parents) {
        (to[0], to[1]) = (first.plus(*parent), second.plus(*parent));
    }
}

#[inline(never)]
fn part<T: Lane>(parents: &[T], from: &[T], (first, second): (&mut [T], &mut [T])) {
    for (((from, first), second), parent) in from.chunks_exact(2).zip(first).zip(second).zip(parents) {
        (*first, *second) = (from[0].minus(*parent), from[1].minus(*parent));
    }
}

//! Weights of the predictions of a channel, fitted by least squares.

use crate::contexts::Contexts;
use crate::grids::Grid;
use crate::lanes::Lane;
use crate::plane_form::{
    MAX_FEATURES, MAX_FRACTION, MIN_FRACTION, Predictor, WEIGHT_BITS, Weights, default_weights, planes,
};
use crate::plane_kernels::is_wanted;
use crate::predict::Level;

/// Minimum side of the parents of sampled levels, unless all levels are smaller.
const MIN_SIDE: usize = 32;
/// One row in this many is sampled.
const ROWS: usize = 8;
/// Maximum magnitude of a weight, in 16ths.
const MAX_WEIGHT: f64 = 31.0;

/// Sums of products of a plane's features and of the difference from the parent. They are exact, so
/// they do not depend on the order of rows.
type Squares = [[i64; MAX_FEATURES + 1]; MAX_FEATURES + 1];

/// Fits the predictor of a channel to the numbers of its dense blocks. `groups` yields the levels
/// of each group of blocks, from the roots down.
pub(crate) fn fit<'b, T: Lane>(
    level: &mut Level<T>,
    groups: impl Iterator<Item = &'b [Grid<T>]> + Clone,
    axes: usize,
) -> Predictor {
    let default = default_weights(axes);
    let max_side =
        groups.clone().filter_map(|grids| grids.last()).map(|grid| grid.shape.side / 2).max().unwrap_or(0);
    let min_side = MIN_SIDE.min(max_side);
    let pairs = || {
        let all = groups.clone().flat_map(|grids| grids.windows(2));
        all.filter(|pair| pair[0].shape.side >= min_side).map(|pair| (&pair[0], &pair[1]))
    };
    // Choose the number of fraction bits so that all differences but one in 1024 fit into a lane.
    let mut bits = [0u64; 65];
    for (parents, children) in pairs() {
        level.take(parents, children);
        for (number, _) in wanted_rows(parents) {
            for changes in &level.changes[..1 << axes] {
                let changes = parents.shape.blocks(row_of(parents, number, changes)).flatten();
                changes.for_each(|change| bits[usize::from(change.size().size_bits())] += 1);
            }
        }
    }
    let all: u64 = bits.iter().sum();
    let (mut wide, mut above) = (0, all);
    while above * 1024 > all {
        above -= bits[wide];
        wide += 1;
    }
    let fraction = T::DIFFERENCE_BITS.saturating_sub(wide as u32).clamp(MIN_FRACTION, MAX_FRACTION);
    let mut squares = vec![[[0; MAX_FEATURES + 1]; MAX_FEATURES + 1]; 1 << axes];
    let mut last = None;
    for (parents, children) in pairs() {
        begin_finished(level, fraction, parents, children);
        for (plane, squares) in squares.iter_mut().enumerate() {
            level.predict_rows(plane, &default, false, step_of(parents.shape.side));
            wanted_rows(parents).for_each(|row| add_row(level, axes, plane, row, squares));
        }
        last = Some(parents);
    }
    let mut predictor = Predictor { fraction, weights: default };
    for (plane, squares) in squares.iter().enumerate() {
        let features = planes(axes)[plane].features(axes);
        predictor.weights[plane] = solve(squares, features, &default[plane]);
    }
    // A few large numbers may dominate least squares, and fitted weights must be stored. So they
    // are used only if they save bits in the sampled rows of the last level, which `level` still
    // has.
    let stored: usize = planes(axes).iter().map(|plane| plane.features(axes)).sum();
    let cost = last.map(|parents| {
        let rows = step_of(parents.shape.side) as u64;
        [&predictor.weights, &default].map(|weights| rows * cost_of(level, parents, weights))
    });
    let is_worth = |[fitted, default]: [u64; 2]| fitted + stored as u64 * u64::from(WEIGHT_BITS) < default;
    if !cost.is_some_and(is_worth) {
        predictor.weights = default;
    }
    predictor
}

/// Returns a row of an array of nodes.
fn row_of<'n, T: Lane, N>(parents: &Grid<T>, number: usize, nodes: &'n [N]) -> &'n [N] {
    let width = parents.shape.width();
    &nodes[number * width..][..width]
}

/// Yields the sampled rows of a level with their indices.
fn wanted_rows<T: Lane>(parents: &Grid<T>) -> impl Iterator<Item = (usize, [usize; 2])> + use<T> {
    let step = step_of(parents.shape.side);
    parents.shape.rows().enumerate().filter(move |(_, row)| is_wanted(*row, step))
}

/// Starts a level, and finishes all its planes.
fn begin_finished<T: Lane>(level: &mut Level<T>, fraction: u32, parents: &Grid<T>, children: &Grid<T>) {
    level.begin(fraction, parents);
    level.take(parents, children);
    (0..1 << parents.shape.axes).for_each(|plane| level.finish(plane));
}

/// Returns `n` if one row in `n` of a level is sampled.
fn step_of(side: usize) -> usize {
    if side >= 2 * ROWS { ROWS } else { 1 }
}

/// Fraction bits of scaled features in sums of products.
const DIGITS: i32 = 14;
/// Limit of the magnitude of scaled features.
const MAX_SCALED: f32 = 2047.0;

/// Adds the products of a row. Each sample is scaled by the inverse of its expected size, as a
/// power of two.
fn add_row<T: Lane>(
    level: &Level<T>,
    axes: usize,
    plane: usize,
    (number, row): (usize, [usize; 2]),
    squares: &mut Squares,
) {
    let shape = level.shape;
    let row_nodes = number * shape.width()..(number + 1) * shape.width();
    let first = Contexts::<T>::residual(plane == 0, 0);
    let bits = shape.blocks(&level.contexts[row_nodes.clone()]).flatten().map(|context| context - first);
    let unit = |bits: u8| {
        // (At least 8, since small sizes are uncertain.)
        let exponent = DIGITS - level.fraction() as i32 - i32::from(bits.max(3));
        f32::from_bits(((127 + exponent) as u32) << 23)
    };
    let units: Vec<f32> = bits.map(unit).collect();
    let width = units.len();
    let count = planes(axes)[plane].features(axes);
    let mut features = vec![0i16; (count + 1) * width];
    let mut put = |feature: usize, numbers: &[T], shift: u32| {
        let to = features[feature * width..][..width].chunks_mut(shape.side);
        for (numbers, (to, units)) in shape.blocks(numbers).zip(to.zip(units.chunks(shape.side))) {
            for ((to, number), unit) in to.iter_mut().zip(numbers).zip(units) {
                *to = round((number.left(shift).to_f32() * unit).clamp(-MAX_SCALED, MAX_SCALED));
            }
        }
    };
    level.features(plane, row, |feature, numbers| put(feature, numbers, 0));
    let child = planes(axes)[plane].child;
    put(count, &level.changes[child][row_nodes], level.fraction());
    for (at, row) in features.chunks_exact(width).enumerate() {
        for (other, with) in features.chunks_exact(width).enumerate().skip(at) {
            squares[at][other] += dot(row, with);
        }
    }
}

/// Rounds a small number to the nearest integer, without the checks of a cast, so that loops are
/// vectorized.
#[inline(always)]
fn round(number: f32) -> i16 {
    // (At this magnitude the last bit of an `f32` is worth 1.)
    const LARGE: f32 = (3 << 22) as f32;
    (number + LARGE).to_bits().wrapping_sub(LARGE.to_bits()) as i16
}

#[inline(never)]
fn dot(a: &[i16], b: &[i16]) -> i64 {
    // Invariant: no 32-bit sum overflows, since numbers are at most MAX_SCALED (11 bits) and a
    // chunk has 256 products. Sums are exact, so all processors find the same weights and write the
    // same bytes, whatever their vector width.
    let sums = a.chunks(256).zip(b.chunks(256)).map(|(a, b)| {
        a.iter().zip(b).map(|(a, b)| i32::from(*a) * i32::from(*b)).fold(0i32, i32::wrapping_add)
    });
    sums.map(i64::from).sum()
}

/// Strength with which weights are pulled to the default ones, as a fraction of the largest sum of
/// squares. Features that hardly vary keep their default.
const RIDGE: f64 = 1e-4;

/// Solves for the least-squares weights, pulled to the default ones (ridge regression), by Gaussian
/// elimination.
fn solve(squares: &Squares, features: usize, default: &[i8; MAX_FEATURES]) -> [i8; MAX_FEATURES] {
    let square = |a: usize, b: usize| squares[a.min(b)][a.max(b)] as f64;
    let most = (0..features).map(|at| square(at, at)).fold(0.0, f64::max);
    let ridge = most * RIDGE + 1.0;
    let mut rows: Vec<Vec<f64>> = (0..features)
        .map(|at| {
            let mut row: Vec<f64> = (0..features).map(|other| square(at, other)).collect();
            row[at] += ridge;
            row.push(square(at, features) + ridge * f64::from(default[at]) / 16.0);
            row
        })
        .collect();
    for at in 0..features {
        let (done, rest) = rows.split_at_mut(at + 1);
        let pivot = &done[at];
        for row in rest {
            let factor = row[at] / pivot[at];
            row[at..].iter_mut().zip(&pivot[at..]).for_each(|(number, pivot)| *number -= factor * pivot);
        }
    }
    let mut solved = vec![0.0; features];
    for at in (0..features).rev() {
        let known: f64 = (at + 1..features).map(|other| rows[at][other] * solved[other]).sum();
        solved[at] = (rows[at][features] - known) / rows[at][at];
    }
    let mut weights = [0; MAX_FEATURES];
    for (weight, solved) in weights.iter_mut().zip(solved) {
        *weight = (solved * 16.0).round().clamp(-MAX_WEIGHT, MAX_WEIGHT) as i8;
    }
    weights
}

/// Estimates the size of the sampled rows with some weights: the sum of the bits of all residuals.
fn cost_of<T: Lane>(level: &mut Level<T>, parents: &Grid<T>, weights: &Weights) -> u64 {
    let shape = parents.shape;
    let mut sum = 0;
    for (plane, what) in planes(shape.axes).iter().enumerate() {
        level.predict_rows(plane, weights, false, step_of(shape.side));
        for (number, _) in wanted_rows(parents) {
            let [changes, expected] = [&level.changes[what.child], &level.expected]
                .map(|nodes| shape.blocks(row_of(parents, number, nodes)).flatten());
            let pairs = changes.zip(expected);
            let bits = pairs.map(|(change, expected)| change.minus(*expected).size().size_bits());
            sum += bits.map(u64::from).sum::<u64>();
        }
    }
    sum
}

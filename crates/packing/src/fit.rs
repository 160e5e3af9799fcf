//! Weights of predictions, fitted to a channel by least squares.

use crate::contexts::Contexts;
use crate::grids::Grid;
use crate::lanes::Lane;
use crate::plane_form::{
    MAX_FEATURES, MAX_FRACTION, MIN_FRACTION, Predictor, Weights, default_weights, planes,
};
use crate::plane_kernels::is_wanted;
use crate::predict::Level;

/// Levels are sampled whose parents are so many along each side at least, but for trees without such ones.
const MIN_SIDE: usize = 32;
/// One row of so many is sampled.
const ROWS: usize = 8;
/// Weights have no more than this, in 16ths.
const MAX_WEIGHT: f64 = 31.0;

/// Sums of products of features and differences from parents, of a plane: exact, so that they do not depend on the order of rows.
type Squares = [[i64; MAX_FEATURES + 1]; MAX_FEATURES + 1];

/// Fits what predicts a channel to the numbers of its dense blocks, each from the root down to the bottom.
pub(crate) fn fit<'b, T: Lane>(
    level: &mut Level<T>,
    blocks: impl Iterator<Item = &'b [Grid<T>]> + Clone,
    axes: usize,
) -> Predictor {
    let default = default_weights(axes);
    let most = blocks.clone().filter_map(|grids| grids.last()).map(|grid| grid.side / 2).max().unwrap_or(0);
    let least = MIN_SIDE.min(most);
    let pairs = || {
        let all = blocks.clone().flat_map(|grids| grids.windows(2));
        all.filter(|pair| pair[0].side >= least).map(|pair| (&pair[0], &pair[1]))
    };
    // Nearly all differences fit into the room for them.
    let mut bits = [0u64; 65];
    for (parents, children) in pairs() {
        level.take(parents, children);
        for (number, _) in wanted_rows(parents) {
            for changes in &level.changes[..1 << axes] {
                let changes = &changes[number * parents.side..][..parents.side];
                changes.iter().for_each(|change| bits[usize::from(change.size().size_bits())] += 1);
            }
        }
    }
    let all: u64 = bits.iter().sum();
    let (mut wide, mut above) = (0, all);
    while above * 1024 > all {
        above -= bits[wide];
        wide += 1;
    }
    let fraction = T::ROOM.saturating_sub(wide as u32).clamp(MIN_FRACTION, MAX_FRACTION);
    let mut squares = vec![[[0; MAX_FEATURES + 1]; MAX_FEATURES + 1]; 1 << axes];
    let mut last = None;
    for (parents, children) in pairs() {
        begin_finished(level, fraction, parents, children);
        for (plane, squares) in squares.iter_mut().enumerate() {
            level.predict_rows(plane, &default, false, step_of(parents.side));
            wanted_rows(parents).for_each(|row| add_row(level, axes, plane, row, squares));
        }
        last = Some(parents);
    }
    let mut predictor = Predictor { fraction, weights: default };
    for (plane, squares) in squares.iter().enumerate() {
        let features = planes(axes)[plane].features(axes);
        predictor.weights[plane] = solve(squares, features, &default[plane]);
    }
    // Few large numbers may have decided: what most samples take counts, of the level that is still there.
    let cost =
        last.map(|parents| [&predictor.weights, &default].map(|weights| cost_of(level, parents, weights)));
    if cost.is_none_or(|[fitted, default]| default <= fitted) {
        predictor.weights = default;
    }
    predictor
}

/// Rows of a level that are sampled, with their numbers.
fn wanted_rows<T: Lane>(parents: &Grid<T>) -> impl Iterator<Item = (usize, [usize; 2])> + use<T> {
    let step = step_of(parents.side);
    parents.rows().enumerate().filter(move |(_, row)| is_wanted(*row, step))
}

/// Begins with a level of which all planes are known.
fn begin_finished<T: Lane>(level: &mut Level<T>, fraction: u32, parents: &Grid<T>, children: &Grid<T>) {
    level.begin(fraction, parents);
    level.take(parents, children);
    (0..1 << parents.axes).for_each(|plane| level.finish(plane));
}

/// One row of so many is sampled.
fn step_of(side: usize) -> usize {
    if side >= 2 * ROWS { ROWS } else { 1 }
}

/// Digits that features have in sums of products.
const DIGITS: i32 = 14;
/// No feature has more than this in them.
const MOST: f32 = 2047.0;

/// Adds the products of a row: of numbers in parts of the expected size, a power of two.
fn add_row<T: Lane>(
    level: &Level<T>,
    axes: usize,
    plane: usize,
    (number, row): (usize, [usize; 2]),
    squares: &mut Squares,
) {
    let width = level.side;
    let first = Contexts::<T>::error(plane == 0, 0);
    let bits = level.contexts[number * width..][..width].iter().map(|context| context - first);
    let unit = |bits: u8| {
        // (At least 8: small sizes are uncertain themselves.)
        let exponent = DIGITS - level.fraction() as i32 - i32::from(bits.max(3));
        f32::from_bits(((127 + exponent) as u32) << 23)
    };
    let units: Vec<f32> = bits.map(unit).collect();
    let count = planes(axes)[plane].features(axes);
    let mut features = vec![0i16; (count + 1) * width];
    let mut put = |feature: usize, numbers: &[T], shift: u32| {
        let to = features[feature * width..][..width].iter_mut();
        for ((to, number), unit) in to.zip(numbers).zip(&units) {
            *to = (number.left(shift).to_f32() * unit).clamp(-MOST, MOST) as i16;
        }
    };
    level.features(plane, row, |feature, numbers| put(feature, numbers, 0));
    let child = planes(axes)[plane].child;
    put(count, &level.changes[child][number * width..][..width], level.fraction());
    for (at, row) in features.chunks_exact(width).enumerate() {
        for (other, with) in features.chunks_exact(width).enumerate().skip(at) {
            squares[at][other] += dot(row, with);
        }
    }
}

#[inline(never)]
fn dot(a: &[i16], b: &[i16]) -> i64 {
    // Invariant: no sum of 32 bits overflows, as numbers are at most MOST (11 bits) and a chunk has 256 products. Sums are exact, so that all
    // processors, whatever vectors they have, find the same weights and write the same bytes.
    let sums = a.chunks(256).zip(b.chunks(256)).map(|(a, b)| {
        a.iter().zip(b).map(|(a, b)| i32::from(*a) * i32::from(*b)).fold(0i32, i32::wrapping_add)
    });
    sums.map(i64::from).sum()
}

/// How much weights are drawn to the default ones, as a fraction of the largest sum of squares: features that hardly vary keep their default.
const RIDGE: f64 = 1e-4;

/// The weights of least squares, a little drawn to those that hold without them (ridge regression), by Gaussian elimination.
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

/// About what the rows that are sampled take with some weights: bits of errors.
fn cost_of<T: Lane>(level: &mut Level<T>, parents: &Grid<T>, weights: &Weights) -> u64 {
    let (side, axes) = (parents.side, parents.axes);
    let mut sum = 0;
    for (plane, what) in planes(axes).iter().enumerate() {
        level.predict_rows(plane, weights, false, step_of(side));
        for (number, _) in wanted_rows(parents) {
            let nodes = number * side..(number + 1) * side;
            let pairs = level.changes[what.child][nodes.clone()].iter().zip(&level.expected[nodes]);
            let bits = pairs.map(|(change, expected)| change.minus(*expected).size().size_bits());
            sum += bits.map(u64::from).sum::<u64>();
        }
    }
    sum
}

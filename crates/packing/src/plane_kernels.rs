//! Vectorized loops over the rows of a level: features, predictions and contexts of all nodes of a
//! plane.

use crate::contexts::Contexts;
use crate::grids::Shape;
use crate::lanes::Lane;
use crate::plane_form::MAX_FEATURES;
use crate::vectorized::vectorized;

/// Numbers of all nodes of a level. With `moved`, they have the border of a grid, and are read at
/// an offset of so many elements; otherwise they have no border.
#[derive(Clone, Copy)]
pub(crate) struct Rows<'t, T> {
    pub(crate) numbers: &'t [T],
    pub(crate) moved: Option<isize>,
}

impl<'t, T: Lane> Rows<'t, T> {
    pub(crate) const NONE: Rows<'static, T> = Rows { numbers: &[], moved: None };

    /// Returns `N` numbers of a row, given the index of the first one without and with a border.
    #[inline(always)]
    fn some<const N: usize>(&self, [plain, bordered]: [usize; 2]) -> Option<&'t [T; N]> {
        let start = self.moved.map_or(plain, |by| bordered.wrapping_add_signed(by));
        self.numbers.get(start..start + N)?.first_chunk()
    }

    /// Returns a row, given the index of its first number without and with a border.
    pub(crate) fn row(&self, [plain, bordered]: [usize; 2], width: usize) -> &'t [T] {
        let start = self.moved.map_or(plain, |by| bordered.wrapping_add_signed(by));
        &self.numbers[start..start + width]
    }
}

/// Features with a weight other than 0, and their weights. Both of a pair of neighbours' children
/// are features of their own.
pub(crate) struct Terms<'t, T> {
    pub(crate) terms: [(Rows<'t, T>, T); MAX_FEATURES],
    pub(crate) count: usize,
    /// Number of features, including those whose weight is 0.
    pub(crate) all: usize,
}

/// Deviations and unevenness, from which expected sizes are computed: see
/// [`crate::plane_form::Plane::own_size`].
pub(crate) struct Sizes<'t, T> {
    pub(crate) uneven: &'t [T],
    pub(crate) own: [Rows<'t, T>; 8],
    pub(crate) owns: usize,
    pub(crate) near: [Rows<'t, T>; 4],
    pub(crate) nears: usize,
    /// Shifts to the left, then to the right, of the sums of `own` and of `near`.
    pub(crate) own_shift: (u32, u32),
    pub(crate) near_shift: (u32, u32),
}

/// Samples of a row that are computed together.
const CHUNK: usize = 16;

impl<T: Lane> Terms<'_, T> {
    /// Returns the weighted sums of the features of `N` samples of a row.
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
    /// Returns the expected sizes of `N` samples of a row: the expected magnitudes of their
    /// residuals, in 64ths.
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

/// Rows of a level that are predicted.
#[derive(Clone, Copy)]
pub(crate) struct Sampled {
    pub(crate) shape: Shape,
    /// One row in `step` is predicted: see [`is_wanted`].
    pub(crate) step: usize,
}

/// Runs a block for each chunk of every row, and another for each remaining sample, with the index
/// in arrays without and with the border of grids.
macro_rules! in_chunks {
    ($rows:expr, |$at:ident| $chunk:block, $one:block) => {
        let Sampled { shape, step } = $rows;
        let Shape { side, axes, .. } = shape;
        let width = shape.width();
        let mut number = 0;
        for z in 0..if axes == 3 { side } else { 1 } {
            for y in 0..side {
                let row = number * width;
                number += 1;
                if !is_wanted([y, z], step) {
                    continue;
                }
                let plane = if axes == 3 { z + 1 } else { 0 };
                let bordered = (plane * (side + 2) + y + 1) * (width + 2) + 1;
                let mut x = 0;
                while x + CHUNK <= width {
                    let $at = [row + x, bordered + x];
                    $chunk
                    x += CHUNK;
                }
                while x < width {
                    let $at = [row + x, bordered + x];
                    $one
                    x += 1;
                }
            }
        }
    };
}

/// Returns `C` numbers from an index on.
#[inline(always)]
fn chunk_mut<N, const C: usize>(numbers: &mut [N], at: usize) -> Option<&mut [N; C]> {
    numbers.get_mut(at..at + C)?.first_chunk_mut()
}

vectorized! {
    /// Predicts differences from parents, and the contexts of their residuals.
    pub(crate) fn predict_differences | predict_differences_baseline | predict_differences_avx2 <T>(
        terms: &Terms<'_, T>,
        sizes: &Sizes<'_, T>,
        rows: Sampled,
        how: (bool, u32, T),
        expected: &mut [T],
        contexts: &mut [u8]
    ) {
        let (is_first, shift, round) = how;
        let base = Contexts::<T>::residual(is_first, 0);
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
        in_chunks!(rows, |at| { some!(CHUNK, at) }, { some!(1, at) });
    }
}

vectorized! {
    /// Predicts sums of differences from parents: the expected difference makes the sum 0, and the
    /// context depends on the expected sum.
    pub(crate) fn predict_sums | predict_sums_baseline | predict_sums_avx2 <T>(
        terms: &Terms<'_, T>,
        sizes: &Sizes<'_, T>,
        rows: Sampled,
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
        in_chunks!(rows, |at| { some!(CHUNK, at) }, { some!(1, at) });
    }
}

vectorized! {
    /// Computes the slopes of a row along an axis per child, in units of 2^-fraction, the
    /// curvatures, and adds the unevenness along the axis.
    pub(crate) fn slope_row | slope_row_baseline | slope_row_avx2<T>(
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
        // (An eighth: a child's centre is a quarter of a cell away, and the difference is over two
        // cells.)
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

/// Computes how the slopes of a row along one axis change along the other: the mixed second
/// difference.
#[inline(never)]
pub(crate) fn across_row<T: Lane>(fraction: u32, corners: [&[T]; 4], across: &mut [T]) {
    let [nw, ne, sw, se] = corners.map(|row| &row[..across.len()]);
    for (x, across) in across.iter_mut().enumerate() {
        *across = se[x].minus(sw[x]).minus(ne[x]).plus(nw[x]).right(6 - fraction.min(6));
    }
}

vectorized! {
    /// Computes the deviations of a row: differences from parents less the interpolated ones, in
    /// units of 2^-fraction.
    pub(crate) fn deviation_row | deviation_row_baseline | deviation_row_avx2<T>(
        fraction: u32,
        slopes: &[(&[T], bool)],
        changes: &[T],
        deviations: &mut [T],
    ) {
        let width = changes.len();
        let deviations = &mut deviations[..width];
        for x in 0..width {
            deviations[x] = changes[x].left(fraction);
        }
        for (row, is_less) in slopes {
            let row = &row[..width];
            if *is_less {
                for x in 0..width {
                    deviations[x] = deviations[x].plus(row[x]);
                }
            } else {
                for x in 0..width {
                    deviations[x] = deviations[x].minus(row[x]);
                }
            }
        }
    }
}

/// Returns whether a row, by its y and z, is the one in `step` that is sampled.
pub(crate) fn is_wanted([y, z]: [usize; 2], step: usize) -> bool {
    (y + z) % step == step / 2
}

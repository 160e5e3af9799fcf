//! Residuals: numbers near 0, coded in the context of their expected magnitude, with adaptive
//! probabilities. (The residuals of planes have static tables: see [`crate::contexts`].)

use crate::adaptive::{AdaptiveSymbols, SYMBOLS};
use crate::bits::{BitCoder, fold, unfold};

/// Number of contexts by expected size: two per doubling.
pub(crate) const SIZES: usize = 128;
/// From this context on, the lower bits of a residual are noise: one bit more per doubling.
const NOISE: usize = 14;

/// Returns the context of an expected size: two per doubling.
#[inline(always)]
pub(crate) fn size_context(size: u64) -> usize {
    if size < 2 {
        return size as usize;
    }
    let bits = (u64::BITS - size.leading_zeros()) as usize;
    2 * bits - 2 + (size >> (bits - 2) & 1) as usize
}

/// Initial probabilities of the symbols of residuals, in units of 2^-15: by context up to 13, then
/// for larger even and larger odd contexts.
///
/// They are averages over elevation rasters and photographs, with expected magnitudes in 64ths as
/// sizes. They are part of the format (section 38 of formats.md), so they must not change. No
/// caller has sizes of just this scale: the probabilities are a start, and soon adapt.
const RESIDUALS: [[i16; SYMBOLS]; 16] = [
    [15472, 4646, 3873, 1555, 1555, 782, 782, 628, 628, 473, 473, 396, 396, 318, 318, 473],
    [32064, 293, 211, 33, 44, 21, 18, 11, 10, 9, 9, 9, 9, 9, 9, 9],
    [31831, 386, 313, 49, 55, 25, 22, 12, 11, 10, 9, 9, 9, 9, 9, 9],
    [29287, 1725, 1314, 121, 139, 56, 36, 15, 11, 10, 9, 9, 9, 9, 9, 9],
    [26461, 3141, 2454, 236, 233, 81, 63, 21, 14, 10, 9, 9, 9, 9, 9, 9],
    [24911, 3691, 3073, 373, 420, 117, 77, 25, 15, 10, 10, 10, 9, 9, 9, 9],
    [24993, 3598, 2782, 479, 546, 158, 97, 32, 17, 11, 10, 9, 9, 9, 9, 9],
    [20461, 5337, 4327, 894, 1057, 327, 208, 61, 29, 12, 10, 9, 9, 9, 9, 9],
    [18860, 5846, 4728, 1071, 1288, 454, 311, 90, 44, 16, 12, 10, 10, 9, 9, 10],
    [15674, 7361, 5612, 1258, 1555, 571, 431, 156, 69, 21, 13, 10, 10, 9, 9, 9],
    [13243, 7758, 6259, 1701, 2073, 716, 570, 232, 117, 32, 18, 11, 10, 10, 9, 9],
    [11375, 7526, 6209, 2453, 2860, 936, 758, 301, 204, 63, 29, 13, 12, 10, 10, 9],
    [9819, 7041, 5824, 2665, 3468, 1706, 1225, 448, 323, 115, 72, 20, 13, 10, 10, 9],
    [8790, 6430, 5278, 2894, 3958, 2054, 1755, 667, 519, 197, 129, 44, 20, 12, 10, 11],
    [8032, 6374, 4693, 3274, 4014, 2245, 2178, 875, 596, 212, 155, 52, 33, 14, 11, 10],
    [5829, 5121, 4217, 3297, 4681, 2887, 3156, 1501, 1179, 391, 288, 102, 68, 24, 16, 11],
];

/// Returns the initial probabilities of a context.
pub(crate) fn initial_symbols(context: usize) -> AdaptiveSymbols {
    let last = RESIDUALS.len() - 2;
    AdaptiveSymbols::new(&RESIDUALS[if context < last { context } else { last + context % 2 }])
}

/// Smallest number of each symbol, and the number of raw bits that follow.
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

/// Codes a residual in the context of its expected size. The scale of sizes is the caller's: 32
/// times a recent magnitude in [`crate::columns`], a range that is not scaled in
/// [`crate::values`]. The scale affects only how many bits are stored raw, and how soon the
/// probabilities suit.
#[inline(always)]
pub(crate) fn code_residual<K: BitCoder>(
    coder: &mut K,
    contexts: &mut [AdaptiveSymbols],
    context: usize,
    residual: i64,
) -> i64 {
    let noise = (context.saturating_sub(NOISE) / 2) as u32;
    let whole = fold(residual);
    let upper = whole >> noise;
    // Each number below 4 has a symbol. Then there are two symbols per doubling, with raw bits. The
    // last symbol is for all larger numbers.
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

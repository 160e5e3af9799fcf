//! Numbers near 0 and small sums, in the context of how large they may be.

use crate::adaptive::{Adaptive, AdaptiveSymbols, SYMBOLS};
use crate::bits::{BitCoder, fold, unfold};
use crate::initial;

/// Contexts of a plane by how much is expected to be wrong: two per doubling.
pub(crate) const SIZES: usize = 128;
/// Contexts of sums: by what they are expected to be, in halves from -2 to 2, and by how much is expected to be wrong.
pub(crate) const SUMS: usize = 9;
pub(crate) const SUM_SIZES: usize = 8;
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
    /// Of errors, by plane and size.
    pub(crate) errors: Vec<AdaptiveSymbols>,
    /// Of sums, by what is expected and size.
    pub(crate) sums: Vec<AdaptiveSymbols>,
    /// Whether floating samples are multiples of a power of two.
    pub(crate) is_scaled: Adaptive,
    /// Whether some of the lowest bits are 0 in a whole level.
    pub(crate) has_steps: Adaptive,
}

impl PlaneContexts {
    pub(crate) fn new(children: usize) -> PlaneContexts {
        let errors = (0..children * SIZES).map(|at| initial::of_errors(at % SIZES)).collect();
        let sums = (0..SUMS * SUM_SIZES).map(|at| initial::of_sums(at / SUM_SIZES)).collect();
        PlaneContexts { errors, sums, is_scaled: Adaptive::default(), has_steps: Adaptive::default() }
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
    let whole = fold(error);
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

/// Codes a small sum.
#[inline(always)]
pub(crate) fn code_sum<K: BitCoder>(
    coder: &mut K,
    contexts: &mut [AdaptiveSymbols],
    context: usize,
    sum: i64,
) -> i64 {
    let symbol = Some(sum.wrapping_add(NO_SUM)).filter(|symbol| (1..16).contains(symbol)).unwrap_or(0);
    match coder.symbol(&mut contexts[context], symbol as usize) {
        0 => coder.signed(sum),
        symbol => symbol as i64 - NO_SUM,
    }
}

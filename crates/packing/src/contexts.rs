//! Contexts of the symbols of planes, and the meaning of symbols in them.
//!
//! With `C` sizes per plane kind ([`Contexts::SIZES`]: 16, 33 or 65 for lanes of 16, 32 or 64
//! bits), the contexts of a channel are
//!
//! | contexts | count | what is coded |
//! | --- | --- | --- |
//! | 0 to `C` - 1 | `C` | residuals of the first plane, by the bits `b` of the expected size |
//! | `C` to 2`C` - 1 | `C` | residuals of the other planes, by `b` |
//! | 2`C` to 2`C` + 35 | 36 | sums of siblings: 2`C` + 16 + 4`h` + min(`b` / 2, 3) |
//! | 2`C` + 36 | 1 | whether any of 8 residuals in context 0 is not 0 |
//! | 2`C` + 37 | 1 | whether any of 8 residuals in context `C` is not 0 |
//! | 2`C` + 38 | 1 | whether any of 8 sums in context 2`C` + 16 is not 0 |
//!
//! where the expected size is in 64ths (see [`crate::plane_form::Plane::own_size`]), and `h` is the
//! expected sum in halves, limited to -4 to 4. So there are 71, 105 or 169 contexts.

use std::marker::PhantomData;

use crate::lanes::Lane;

/// Symbols of a context.
pub(crate) const SYMBOLS: usize = 16;
/// Symbol of numbers that no other symbol has. All bits of the number follow as raw bits.
pub(crate) const ESCAPE: usize = SYMBOLS - 1;
/// If the expected size of a residual has more bits than this (a magnitude of 4 or more), each
/// further bit adds one lowest bit that is noise and is stored raw.
const NOISE: usize = 8;
/// Number of contexts of sums: by the expected sum, -4 to 4 halves, and by the expected size.
const SUMS: usize = 9 * SUM_SIZES;
const SUM_SIZES: usize = 4;
/// Number of samples that one symbol codes if all are as expected, in contexts of minimum
/// uncertainty.
pub(crate) const FLAT: usize = 8;
/// Maximum number of contexts of a channel's planes.
pub(crate) const MAX_PLANE_CONTEXTS: usize = 256;

/// Kind of the numbers of a context.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Residual in the first plane or another one, by the bits of the expected size.
    Residual { is_first: bool, size: usize },
    /// Sum of siblings, by the expected sum in halves plus 4 (0 to 8), and by the expected size.
    Sum { halves: usize, size: usize },
    /// Whether any of [`FLAT`] samples is not as expected: in the first plane (0), in others (1),
    /// or of sums (2).
    Flat(usize),
}

/// Contexts of lanes of a given width.
pub(crate) struct Contexts<T>(PhantomData<T>);

impl<T: Lane> Contexts<T> {
    /// Number of bit counts of expected sizes, each with a context of residuals. (Sizes of 16-bit
    /// lanes have at most 15 bits.)
    pub(crate) const SIZES: usize = if T::BITS == 16 { 16 } else { T::BITS as usize + 1 };
    const FIRST_FLAT: usize = 2 * Self::SIZES + SUMS;
    pub(crate) const COUNT: usize = Self::FIRST_FLAT + 3;

    /// Returns the context of a residual in the first plane or another one.
    #[inline(always)]
    pub(crate) fn residual(is_first: bool, size_bits: u8) -> u8 {
        size_bits + if is_first { 0 } else { Self::SIZES as u8 }
    }

    /// Returns the context of a sum whose expected value is `halves` halves, from -4 to 4.
    #[inline(always)]
    pub(crate) fn sum(halves: i8, size_bits: u8) -> u8 {
        (2 * Self::SIZES as u8 + 16).wrapping_add_signed(4 * halves)
            + (size_bits / 2).min(SUM_SIZES as u8 - 1)
    }

    /// Returns the context of minimum uncertainty, and the context of whether several samples are
    /// all as expected there.
    pub(crate) fn flat(is_first: bool, is_sum: bool) -> FlatContexts {
        let (context, number) = match (is_first, is_sum) {
            (true, false) => (Self::residual(true, 0), 0),
            (false, false) => (Self::residual(false, 0), 1),
            (_, true) => (Self::sum(0, 0), 2),
        };
        FlatContexts { context, all: (Self::FIRST_FLAT + number) as u8 }
    }

    pub(crate) fn kind(context: usize) -> Kind {
        if context < 2 * Self::SIZES {
            let is_first = context < Self::SIZES;
            return Kind::Residual { is_first, size: context % Self::SIZES };
        }
        match context.checked_sub(Self::FIRST_FLAT) {
            Some(number) => Kind::Flat(number),
            None => {
                let sum = context - 2 * Self::SIZES;
                Kind::Sum { halves: sum / SUM_SIZES, size: sum % SUM_SIZES }
            }
        }
    }

    /// Returns how many of the lowest bits of a number in a context are not covered by its symbol.
    pub(crate) fn noise(context: usize) -> u32 {
        match Self::kind(context) {
            Kind::Residual { size, .. } => size.saturating_sub(NOISE) as u32,
            _ => 0,
        }
    }

    /// Returns the meaning of a symbol in a context: the upper bits of a number, and how many lower
    /// bits follow.
    #[inline]
    pub(crate) fn meaning(context: usize, symbol: usize) -> (u32, u32) {
        let noise = Self::noise(context);
        let is_residual = matches!(Self::kind(context), Kind::Residual { .. });
        match symbol {
            ESCAPE => (0, T::BITS),
            0..4 => (symbol as u32, noise),
            _ if is_residual => (2 | symbol as u32 & 1, symbol as u32 / 2 - 1 + noise),
            _ => (symbol as u32, noise),
        }
    }

    /// Returns the symbol of a number in a context of residuals.
    #[inline(always)]
    pub(crate) fn residual_symbol(number: u64, noise: u32) -> u8 {
        RESIDUAL_SYMBOLS[(number >> noise).min(255) as usize]
    }

    /// Returns the symbol of a number in a context of sums.
    #[inline(always)]
    pub(crate) fn sum_symbol(number: u64) -> u8 {
        number.min(ESCAPE as u64) as u8
    }
}

/// Context of minimum uncertainty.
#[derive(Clone, Copy)]
pub(crate) struct FlatContexts {
    pub(crate) context: u8,
    /// Context of whether any of [`FLAT`] samples in `context` is not as expected.
    pub(crate) all: u8,
}

/// Symbols of residuals: one for each number up to 3, then two per doubling; larger numbers are
/// escapes.
static RESIDUAL_SYMBOLS: [u8; 256] = {
    let mut symbols = [ESCAPE as u8; 256];
    let mut number = 0;
    while number < symbols.len() {
        if number < 4 {
            symbols[number] = number as u8;
        } else {
            let highest = number.ilog2();
            let symbol = 2 * highest as usize + (number >> (highest - 1) & 1);
            if symbol < ESCAPE {
                symbols[number] = symbol as u8;
            }
        }
        number += 1;
    }
    symbols
};

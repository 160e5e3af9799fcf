//! Contexts of what is coded in planes, and what symbols mean there.

use std::marker::PhantomData;

use crate::lanes::Lane;

/// Symbols of a context.
pub(crate) const SYMBOLS: usize = 16;
/// The symbol of numbers that no other symbol has: all of their bits follow.
pub(crate) const ESCAPE: usize = SYMBOLS - 1;
/// Errors whose size has more bits than this have lower bits that are as often set as not: one more per bit.
const NOISE: usize = 8;
/// Contexts of sums: by what they are expected to be, in halves from -2 to 2, and by the expected size.
const SUMS: usize = 9 * SUM_SIZES;
const SUM_SIZES: usize = 4;
/// Samples that are coded by one symbol if they are all as expected in contexts without any uncertainty.
pub(crate) const FLAT: usize = 8;
/// Contexts at most.
pub(crate) const MAX_CONTEXTS: usize = 256;

/// Kind of numbers that a context has.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Errors of the first plane, or of others, by bits of the expected size.
    Error { is_first: bool, size: usize },
    /// Sums of siblings, by halves from 0 to 8 and size.
    Sum { halves: usize, size: usize },
    /// Whether any of [`FLAT`] samples is not as expected: in the first plane, in others, of sums.
    Flat(usize),
}

/// The contexts of lanes of some width.
pub(crate) struct Contexts<T>(PhantomData<T>);

impl<T: Lane> Contexts<T> {
    /// Sizes that errors are distinguished by. (Sizes of 16 bits have no sign.)
    pub(crate) const SIZES: usize = if T::BITS == 16 { 16 } else { T::BITS as usize + 1 };
    const FIRST_FLAT: usize = 2 * Self::SIZES + SUMS;
    pub(crate) const COUNT: usize = Self::FIRST_FLAT + 3;

    /// The context of an error in the first plane or another one.
    #[inline(always)]
    pub(crate) fn error(is_first: bool, size_bits: u8) -> u8 {
        size_bits + if is_first { 0 } else { Self::SIZES as u8 }
    }

    /// The context of a sum that is expected to have so many halves, from -4 to 4.
    #[inline(always)]
    pub(crate) fn sum(halves: i8, size_bits: u8) -> u8 {
        (2 * Self::SIZES as u8 + 16).wrapping_add_signed(4 * halves)
            + (size_bits / 2).min(SUM_SIZES as u8 - 1)
    }

    /// The context without any uncertainty, and the one for whether all of several samples are as expected there.
    pub(crate) fn flat(is_first: bool, is_sum: bool) -> FlatContexts {
        let (context, number) = match (is_first, is_sum) {
            (true, false) => (Self::error(true, 0), 0),
            (false, false) => (Self::error(false, 0), 1),
            (_, true) => (Self::sum(0, 0), 2),
        };
        FlatContexts { context, all: (Self::FIRST_FLAT + number) as u8 }
    }

    pub(crate) fn kind(context: usize) -> Kind {
        if context < 2 * Self::SIZES {
            let is_first = context < Self::SIZES;
            return Kind::Error { is_first, size: context % Self::SIZES };
        }
        match context.checked_sub(Self::FIRST_FLAT) {
            Some(number) => Kind::Flat(number),
            None => {
                let sum = context - 2 * Self::SIZES;
                Kind::Sum { halves: sum / SUM_SIZES, size: sum % SUM_SIZES }
            }
        }
    }

    /// The lowest bits of a number in a context that are no part of its symbol.
    pub(crate) fn noise(context: usize) -> u32 {
        match Self::kind(context) {
            Kind::Error { size, .. } => size.saturating_sub(NOISE) as u32,
            _ => 0,
        }
    }

    /// Meaning of a symbol in a context: the upper bits of a number, and how many lower bits follow.
    #[inline]
    pub(crate) fn meaning(context: usize, symbol: usize) -> (u32, u32) {
        let noise = Self::noise(context);
        let is_error = matches!(Self::kind(context), Kind::Error { .. });
        match symbol {
            ESCAPE => (0, T::BITS),
            0..4 => (symbol as u32, noise),
            _ if is_error => (2 | symbol as u32 & 1, symbol as u32 / 2 - 1 + noise),
            _ => (symbol as u32, noise),
        }
    }

    /// The symbol of a number in a context of errors.
    #[inline(always)]
    pub(crate) fn error_symbol(number: u64, noise: u32) -> u8 {
        ERROR_SYMBOLS[(number >> noise).min(255) as usize]
    }

    /// The symbol of a number in a context of sums.
    #[inline(always)]
    pub(crate) fn sum_symbol(number: u64) -> u8 {
        number.min(ESCAPE as u64) as u8
    }
}

/// A context without any uncertainty.
#[derive(Clone, Copy)]
pub(crate) struct FlatContexts {
    pub(crate) context: u8,
    /// The context of whether all of [`FLAT`] samples in that one are as expected.
    pub(crate) all: u8,
}

/// The symbols of errors: up to 3 each has one; then there are two per doubling, and the last is all that is larger.
static ERROR_SYMBOLS: [u8; 256] = {
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

//! Integers of 16, 32 and 64 bits that planes are computed with: all arithmetic wraps, so that no number is refused and none has two results.

use std::cell::RefCell;

use crate::planes::Scratch;

/// An integer that samples and their differences are computed with.
pub(crate) trait Lane: Copy + Default + PartialEq + 'static {
    /// Calls with the memory that a thread uses again and again.
    fn with_scratch<R>(call: impl FnOnce(&mut Scratch<Self>) -> R) -> R;
    const BITS: u32;
    /// Bits that a difference and its fraction take together, so that sums of some of them fit.
    const ROOM: u32;
    fn from_i64(number: i64) -> Self;
    fn to_i64(self) -> i64;
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
    fn left(self, bits: u32) -> Self;
    fn right(self, bits: u32) -> Self;
    fn or(self, other: Self) -> Self;
    fn xor(self, other: Self) -> Self;
    /// The size of a difference.
    fn size(self) -> Self;
    /// The sum of two sizes: of 16 bits at most the maximum, else it wraps.
    fn add_size(self, other: Self) -> Self;
    /// A size times a power of two: of 16 bits at most the maximum, else it wraps.
    fn grow_size(self, bits: u32) -> Self;
    /// Bits of a size, without those that are 0 above all others.
    fn size_bits(self) -> u8;
    /// A number between -4 and 4, as near as can be.
    fn within_4(self) -> i8;
    /// A weight as [`Lane::times`] takes it.
    fn weight(sixty_fourths: i8) -> Self;
    /// A number times a weight, in 64ths, rounded down.
    fn times(self, weight: Self) -> Self;
    /// A number with its sign in the lowest bit: 2n, or -2n - 1.
    fn fold(self) -> Self;
    /// The number that [`Lane::fold`] made another one of.
    fn unfold(self) -> Self;
    /// The bits as a number without a sign.
    fn bits(self) -> u64;
    fn to_f32(self) -> f32;
}

macro_rules! wide_sizes {
    ($signed:ty, $unsigned:ty) => {
        #[inline(always)]
        fn size(self) -> $signed {
            self.wrapping_abs()
        }
        #[inline(always)]
        fn add_size(self, other: $signed) -> $signed {
            self.wrapping_add(other)
        }
        #[inline(always)]
        fn grow_size(self, bits: u32) -> $signed {
            self << bits
        }
        #[inline(always)]
        fn size_bits(self) -> u8 {
            (<$unsigned>::BITS - (self as $unsigned).leading_zeros()) as u8
        }
        #[inline(always)]
        fn weight(sixty_fourths: i8) -> $signed {
            sixty_fourths.into()
        }
        #[inline(always)]
        fn times(self, weight: $signed) -> $signed {
            self.wrapping_mul(weight) >> 6
        }
    };
}

macro_rules! narrow_sizes {
    () => {
        #[inline(always)]
        fn size(self) -> i16 {
            self.max(0i16.saturating_sub(self))
        }
        #[inline(always)]
        fn add_size(self, other: i16) -> i16 {
            self.saturating_add(other)
        }
        #[inline(always)]
        fn grow_size(self, bits: u32) -> i16 {
            self.min(i16::MAX >> bits) << bits
        }
        #[inline(always)]
        fn size_bits(self) -> u8 {
            // (Of the exponent of a float: processors without an instruction for bits have vectors of floats.)
            ((f32::from(self).to_bits() >> 23) as i32 - 126).max(0) as u8
        }
        #[inline(always)]
        fn weight(sixty_fourths: i8) -> i16 {
            i16::from(sixty_fourths) << 10
        }
        #[inline(always)]
        fn times(self, weight: i16) -> i16 {
            ((i32::from(self) * i32::from(weight)) >> 16) as i16
        }
    };
}

macro_rules! lane {
    ($signed:ty, $unsigned:ty, $room:literal, $sizes:ident!($($types:ty),*)) => {
        impl Lane for $signed {
            fn with_scratch<R>(call: impl FnOnce(&mut Scratch<$signed>) -> R) -> R {
                thread_local! {
                    static SCRATCH: RefCell<Scratch<$signed>> = RefCell::default();
                }
                // (Nothing that is called decodes anything itself.)
                SCRATCH.with_borrow_mut(call)
            }
            const BITS: u32 = <$signed>::BITS;
            const ROOM: u32 = $room;
            #[inline(always)]
            fn from_i64(number: i64) -> $signed {
                number as $signed
            }
            #[inline(always)]
            fn to_i64(self) -> i64 {
                self as i64
            }
            #[inline(always)]
            fn plus(self, other: $signed) -> $signed {
                self.wrapping_add(other)
            }
            #[inline(always)]
            fn minus(self, other: $signed) -> $signed {
                self.wrapping_sub(other)
            }
            #[inline(always)]
            fn left(self, bits: u32) -> $signed {
                self << (bits & (<$signed>::BITS - 1))
            }
            #[inline(always)]
            fn right(self, bits: u32) -> $signed {
                self >> (bits & (<$signed>::BITS - 1))
            }
            #[inline(always)]
            fn or(self, other: $signed) -> $signed {
                self | other
            }
            #[inline(always)]
            fn xor(self, other: $signed) -> $signed {
                self ^ other
            }
            #[inline(always)]
            fn within_4(self) -> i8 {
                self.max(-4).min(4) as i8
            }
            #[inline(always)]
            fn fold(self) -> $signed {
                self << 1 ^ self >> (<$signed>::BITS - 1)
            }
            #[inline(always)]
            fn unfold(self) -> $signed {
                (self as $unsigned >> 1) as $signed ^ (self & 1).wrapping_neg()
            }
            #[inline(always)]
            fn bits(self) -> u64 {
                self as $unsigned as u64
            }
            #[inline(always)]
            fn to_f32(self) -> f32 {
                self as f32
            }
            $sizes!($($types),*);
        }
    };
}

lane!(i16, u16, 14, narrow_sizes!());
lane!(i32, u32, 26, wide_sizes!(i32, u32));
lane!(i64, u64, 58, wide_sizes!(i64, u64));

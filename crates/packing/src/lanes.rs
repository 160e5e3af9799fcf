//! Integers of 16, 32 and 64 bits for computing with planes. All arithmetic wraps, so every input
//! is valid and has exactly one result.

use std::cell::RefCell;

use crate::planes::Scratch;

/// Integer type for samples and their differences.
pub(crate) trait Lane: Copy + Default + PartialEq + 'static {
    /// Calls a function with the thread's reused buffers.
    fn with_scratch<R>(call: impl FnOnce(&mut Scratch<Self>) -> R) -> R;
    const BITS: u32;
    /// Bits available for a difference and its fraction, so that sums of several features still
    /// fit.
    const DIFFERENCE_BITS: u32;
    fn from_i64(number: i64) -> Self;
    fn to_i64(self) -> i64;
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
    fn left(self, bits: u32) -> Self;
    fn right(self, bits: u32) -> Self;
    fn or(self, other: Self) -> Self;
    fn xor(self, other: Self) -> Self;
    /// Returns the magnitude of a difference.
    fn size(self) -> Self;
    /// Adds two magnitudes: saturating in 16 bits, otherwise wrapping.
    fn add_size(self, other: Self) -> Self;
    /// Multiplies a magnitude by a power of two: saturating in 16 bits, otherwise wrapping.
    fn grow_size(self, bits: u32) -> Self;
    /// Returns the number of bits of a magnitude, without leading zeros.
    fn size_bits(self) -> u8;
    /// Clamps a number to -4 to 4.
    fn within_4(self) -> i8;
    /// Converts a weight in 16ths to the argument of [`Lane::times`].
    fn weight(sixteenths: i8) -> Self;
    /// Multiplies a feature by a converted weight, rounded down, and drops
    /// [`MIN_FRACTION`](crate::plane_form::MIN_FRACTION) fraction bits: a shift by 4 + 2 bits.
    fn times(self, weight: Self) -> Self;
    /// Moves the sign to the lowest bit: 2n, or -2n - 1.
    fn fold(self) -> Self;
    /// Reverses [`Lane::fold`].
    fn unfold(self) -> Self;
    /// Returns the bit pattern as an unsigned number.
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
        fn weight(sixteenths: i8) -> $signed {
            sixteenths.into()
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
            // (From the exponent of a float: processors without a vector instruction for leading
            // zeros have vectors of floats.)
            ((f32::from(self).to_bits() >> 23) as i32 - 126).max(0) as u8
        }
        // (Shifts by 10 to the left and by 16 to the right: by 6 to the right. The upper half of a
        // product of 16-bit numbers is one vector instruction.)
        #[inline(always)]
        fn weight(sixteenths: i8) -> i16 {
            i16::from(sixteenths) << 10
        }
        #[inline(always)]
        fn times(self, weight: i16) -> i16 {
            ((i32::from(self) * i32::from(weight)) >> 16) as i16
        }
    };
}

macro_rules! lane {
    ($signed:ty, $unsigned:ty, $difference_bits:literal, $sizes:ident!($($types:ty),*)) => {
        impl Lane for $signed {
            fn with_scratch<R>(call: impl FnOnce(&mut Scratch<$signed>) -> R) -> R {
                thread_local! {
                    static SCRATCH: RefCell<Scratch<$signed>> = RefCell::default();
                }
                // (`call` never borrows the buffers again, since it decodes nothing else.)
                SCRATCH.with_borrow_mut(call)
            }
            const BITS: u32 = <$signed>::BITS;
            const DIFFERENCE_BITS: u32 = $difference_bits;
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

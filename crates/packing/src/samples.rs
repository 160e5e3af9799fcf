//! Samples as whole numbers in their order, and back.

use spinney_base::value::SampleType;

/// A whole number that arithmetic wraps round in.
pub(crate) trait Whole: Copy + Default + Ord {
    fn from_i64(number: i64) -> Self;
    fn to_i64(self) -> i64;
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn times(self, factor: i32) -> Self;
    /// Divided by a power of two, downwards.
    fn down(self, shift: u32) -> Self;
    /// The distance from 0.
    fn size(self) -> Self::Size;
    /// What distances are added up in.
    type Size: Copy + Default;
    fn grow(size: Self::Size, more: Self::Size, factor: u32) -> Self::Size;
    fn shrink(size: Self::Size, shift: u32) -> Self::Size;
    fn to_u64(size: Self::Size) -> u64;
}

macro_rules! whole {
    ($signed:ty, $unsigned:ty) => {
        impl Whole for $signed {
            #[inline(always)]
            fn from_i64(number: i64) -> $signed {
                number as $signed
            }
            #[inline(always)]
            fn to_i64(self) -> i64 {
                self as i64
            }
            #[inline(always)]
            fn add(self, other: $signed) -> $signed {
                self.wrapping_add(other)
            }
            #[inline(always)]
            fn sub(self, other: $signed) -> $signed {
                self.wrapping_sub(other)
            }
            #[inline(always)]
            fn times(self, factor: i32) -> $signed {
                self.wrapping_mul(factor as $signed)
            }
            #[inline(always)]
            fn down(self, shift: u32) -> $signed {
                self >> shift
            }
            #[inline(always)]
            fn size(self) -> $unsigned {
                self.unsigned_abs()
            }
            type Size = $unsigned;
            #[inline(always)]
            fn grow(size: $unsigned, more: $unsigned, factor: u32) -> $unsigned {
                size.wrapping_add(more.wrapping_mul(factor as $unsigned))
            }
            #[inline(always)]
            fn shrink(size: $unsigned, shift: u32) -> $unsigned {
                size >> shift
            }
            #[inline(always)]
            fn to_u64(size: $unsigned) -> u64 {
                size as u64
            }
        }
    };
}

whole!(i32, u32);
whole!(i64, u64);

/// Whether samples and all that is made of them fit into 32 bits.
pub(crate) fn is_narrow(sample: SampleType) -> bool {
    sample.size() <= 2
}

/// The order of floating numbers as that of whole ones (IEEE 754 total order), and back: all but the sign are turned round where it
/// is set.
fn turn(bits: i64, width: u32) -> i64 {
    bits ^ (bits >> 63) & (i64::MAX >> (u64::BITS - width))
}

/// The sample at the beginning of some bytes. Unsigned samples of 64 bits lose their order, and nothing else.
#[inline(always)]
pub(crate) fn read(sample: SampleType, bytes: &[u8]) -> i64 {
    fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
        *bytes.first_chunk().unwrap_or(&[0; N])
    }
    match sample {
        SampleType::U8 => i64::from(bytes[0]),
        SampleType::I8 => i64::from(bytes[0] as i8),
        SampleType::U16 => i64::from(u16::from_le_bytes(first(bytes))),
        SampleType::I16 => i64::from(i16::from_le_bytes(first(bytes))),
        SampleType::U32 => i64::from(u32::from_le_bytes(first(bytes))),
        SampleType::I32 => i64::from(i32::from_le_bytes(first(bytes))),
        SampleType::F32 => turn(i64::from(i32::from_le_bytes(first(bytes))), 32),
        SampleType::F64 => turn(i64::from_le_bytes(first(bytes)), 64),
        SampleType::U64 | SampleType::I64 => i64::from_le_bytes(first(bytes)),
    }
}

/// Writes a sample; of a number that is none, the lower bits.
#[inline(always)]
pub(crate) fn write(sample: SampleType, number: i64, bytes: &mut [u8]) {
    write_all(sample, [number].into_iter(), bytes, sample.size());
}

/// Writes samples, each so many bytes behind the one before.
#[inline(always)]
pub(crate) fn write_all(
    sample: SampleType,
    numbers: impl Iterator<Item = i64>,
    bytes: &mut [u8],
    width: usize,
) {
    #[inline(always)]
    fn each<const N: usize>(
        numbers: impl Iterator<Item = i64>,
        bytes: &mut [u8],
        width: usize,
        sample: impl Fn(i64) -> [u8; N],
    ) {
        for (number, bytes) in numbers.zip(bytes.chunks_mut(width)) {
            if let Some(bytes) = bytes.first_chunk_mut() {
                *bytes = sample(number);
            }
        }
    }
    match sample {
        SampleType::U8 | SampleType::I8 => each(numbers, bytes, width, |number| [number as u8]),
        SampleType::U16 | SampleType::I16 => {
            each(numbers, bytes, width, |number| (number as u16).to_le_bytes());
        }
        SampleType::U32 | SampleType::I32 => {
            each(numbers, bytes, width, |number| (number as u32).to_le_bytes());
        }
        SampleType::F32 => {
            each(numbers, bytes, width, |number| (turn(i64::from(number as i32), 32) as u32).to_le_bytes());
        }
        SampleType::F64 => each(numbers, bytes, width, |number| turn(number, 64).to_le_bytes()),
        SampleType::U64 | SampleType::I64 => each(numbers, bytes, width, i64::to_le_bytes),
    }
}

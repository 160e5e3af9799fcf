//! Samples as whole numbers in their order, and back.

use spinney_base::value::SampleType;

use crate::adaptive::Adaptive;
use crate::bits::BitCoder;

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
    /// A number without a sign, as large: distances, and sums of them.
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

/// How the samples of a channel become whole numbers in a dense block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Numbering {
    sample: SampleType,
    /// Of floating samples: the power of two times which all are whole; if none is told, they are their bits.
    scale: Option<i8>,
}

/// The bits of the place of a scale among numbers with as many bits.
const SCALE_BITS: u32 = 8;
/// Whole numbers of floating samples have at most so many bits.
const MAX_BITS: i32 = 62;

impl Numbering {
    /// By the order of the samples.
    pub(crate) fn ordered(sample: SampleType) -> Numbering {
        Numbering { sample, scale: None }
    }

    /// The one that suits samples of all nodes of a block and, among these, those at its bottom: as multiples of a power of two if
    /// these have fewer digits than there is room for, as if they had been rounded.
    pub(crate) fn choose(
        sample: SampleType,
        all: impl Iterator<Item = f64>,
        bottom: impl Iterator<Item = f64>,
    ) -> Numbering {
        let ordered = Numbering::ordered(sample);
        let (Some(all), Some(bottom)) = (digits(all), digits(bottom)) else { return ordered };
        // (Digits of a sample: 24 and 53.)
        let few = if sample == SampleType::F32 { 22 } else { 50 };
        let is_rounded = bottom.1 - bottom.0 < few && all.1 - all.0 < MAX_BITS;
        let scale = i8::try_from(-all.0).ok().filter(|_| is_rounded);
        Numbering { scale, ..ordered }
    }

    /// Codes it.
    pub(crate) fn code<K: BitCoder>(self, coder: &mut K, is_scaled: &mut Adaptive) -> Numbering {
        if !self.sample.is_float() || !coder.bit(is_scaled, self.scale.is_some()) {
            return Numbering { scale: None, ..self };
        }
        let scale = coder.raw(u64::from(self.scale.unwrap_or_default() as u8), SCALE_BITS);
        Numbering { scale: Some(scale as u8 as i8), ..self }
    }

    /// Bytes of a sample.
    pub(crate) fn size(self) -> usize {
        self.sample.size()
    }

    /// The whole number of the sample at the beginning of some bytes.
    #[inline(always)]
    pub(crate) fn read(self, bytes: &[u8]) -> i64 {
        match self.scale {
            None => read(self.sample, bytes),
            Some(scale) => (read_float(self.sample, bytes) * power(scale)) as i64,
        }
    }

    /// Writes samples, each so many bytes behind the one before.
    #[inline(always)]
    pub(crate) fn write_all(self, numbers: impl Iterator<Item = i64>, bytes: &mut [u8], width: usize) {
        let Some(scale) = self.scale else { return write_all(self.sample, numbers, bytes, width) };
        // (Powers of two: neither product is rounded, but where a sample has no room for all digits.)
        let factor = 1.0 / power(scale);
        for (number, bytes) in numbers.zip(bytes.chunks_mut(width)) {
            let number = number as f64 * factor;
            match self.sample {
                SampleType::F32 => bytes[..4].copy_from_slice(&(number as f32).to_le_bytes()),
                _ => bytes[..8].copy_from_slice(&number.to_le_bytes()),
            }
        }
    }
}

/// A power of two.
fn power(exponent: i8) -> f64 {
    f64::from_bits(((1023 + i64::from(exponent)) as u64) << 52)
}

/// The floating sample at the beginning of some bytes.
#[inline(always)]
pub(crate) fn read_float(sample: SampleType, bytes: &[u8]) -> f64 {
    match (sample, bytes.first_chunk(), bytes.first_chunk()) {
        (SampleType::F32, Some(bytes), _) => f64::from(f32::from_le_bytes(*bytes)),
        (SampleType::F64, _, Some(bytes)) => f64::from_le_bytes(*bytes),
        _ => 0.0,
    }
}

/// The places of the lowest digit that any of some numbers has, and of the highest, as powers of two. `None` if one is no number, or
/// a zero with a sign, which whole numbers are not.
fn digits(numbers: impl Iterator<Item = f64>) -> Option<(i32, i32)> {
    let (mut lowest, mut highest) = (i32::MAX, i32::MIN);
    for number in numbers {
        let bits = number.to_bits();
        let (exponent, fraction) = ((bits >> 52 & 0x7ff) as i32, bits & ((1 << 52) - 1));
        if !number.is_finite() || bits == (-0.0f64).to_bits() {
            return None;
        }
        if bits != 0 {
            // (Numbers that are nearly 0 have no leading digit; they are far beyond all scales.)
            let fraction = fraction | 1 << 52;
            lowest = lowest.min(exponent - 1075 + fraction.trailing_zeros() as i32);
            highest = highest.max(exponent - 1023);
        }
    }
    Some(if lowest == i32::MAX { (0, 0) } else { (lowest, highest) })
}

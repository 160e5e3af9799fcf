//! Conversion of samples to integers of the same order, and back.

use spinney_base::value::SampleType;

use crate::lanes::Lane;
use crate::symbols::{HeaderReader, HeaderWriter};

/// Returns whether samples have at most 16 bits.
pub(crate) fn is_narrow(sample: SampleType) -> bool {
    sample.size() <= 2
}

/// Maps the bits of a floating-point number to an integer of the same order (IEEE 754 totalOrder),
/// and back: if the sign bit is set, all other bits are inverted.
fn turn(bits: i64, width: u32) -> i64 {
    bits ^ (bits >> 63) & (i64::MAX >> (u64::BITS - width))
}

/// Reads the sample at the beginning of some bytes. Unsigned 64-bit samples lose their order, but
/// no bits.
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

/// Writes a sample. A number outside the sample's range loses its upper bits.
#[inline(always)]
pub(crate) fn write(sample: SampleType, number: i64, bytes: &mut [u8]) {
    write_all(sample, [number].into_iter(), bytes, sample.size());
}

/// Writes samples, each `width` bytes after the one before.
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
        if width == N {
            for (number, bytes) in numbers.zip(bytes.as_chunks_mut::<N>().0) {
                *bytes = sample(number);
            }
            return;
        }
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

/// Mapping from the samples of a channel to integers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Numbering {
    sample: SampleType,
    /// For floating samples, the exponent of the power of two by which samples are multiplied to
    /// become integers. `None` maps their bit patterns.
    scale: Option<i8>,
    /// Bits of the lanes in which numbers are computed: 16, 32 or 64.
    pub(crate) lanes: u32,
}

/// Maximum number of bits of scaled floating samples, in lanes of 64 bits and of 32 bits.
const MAX_BITS: i32 = 62;
const MAX_MIDDLE_BITS: i32 = 29;

impl Numbering {
    /// Returns the mapping that keeps the order of the samples.
    pub(crate) fn ordered(sample: SampleType) -> Numbering {
        let lanes = match sample.size() {
            1 | 2 => 16,
            4 => 32,
            _ => 64,
        };
        Numbering { sample, scale: None, lanes }
    }

    /// Chooses the mapping of floating samples, given those of all nodes, and among these those at
    /// the bottom of dense blocks. If the samples at the bottom use fewer binary digits than their
    /// type has, as rounded values do, numbers are multiples of a power of two.
    pub(crate) fn choose(
        sample: SampleType,
        all: impl Iterator<Item = f64>,
        bottom: impl Iterator<Item = f64>,
    ) -> Numbering {
        let ordered = Numbering::ordered(sample);
        let (Some(all), Some(bottom)) = (digits(all), digits(bottom)) else { return ordered };
        // (The types have 24 and 53 digits.)
        let few = if sample == SampleType::F32 { 22 } else { 50 };
        let bits = all.1 - all.0;
        let is_rounded = bottom.1 - bottom.0 < few && bits < MAX_BITS;
        match i8::try_from(-all.0).ok().filter(|_| is_rounded) {
            Some(scale) => {
                Numbering { sample, scale: Some(scale), lanes: if bits < MAX_MIDDLE_BITS { 32 } else { 64 } }
            }
            None => ordered,
        }
    }

    /// Returns the number of mantissa bits, if numbers are the bit patterns of floating samples.
    pub(crate) fn mantissa(self) -> Option<u32> {
        match (self.sample, self.scale) {
            (SampleType::F32, None) => Some(f32::MANTISSA_DIGITS - 1),
            (SampleType::F64, None) => Some(f64::MANTISSA_DIGITS - 1),
            _ => None,
        }
    }

    pub(crate) fn write(self, header: &mut HeaderWriter) {
        if self.sample.is_float() {
            header.put(self.scale.is_some().into(), 1);
            if let Some(scale) = self.scale {
                header.put(u64::from(scale as u8), 8);
                header.put((self.lanes == 64).into(), 1);
            }
        }
    }

    pub(crate) fn read_from(sample: SampleType, header: &mut HeaderReader<'_>) -> Numbering {
        if !sample.is_float() || header.take(1) == 0 {
            return Numbering::ordered(sample);
        }
        let scale = Some(header.take(8) as u8 as i8);
        Numbering { sample, scale, lanes: if header.take(1) == 1 { 64 } else { 32 } }
    }

    /// Returns the bytes of a sample.
    pub(crate) fn size(self) -> usize {
        self.sample.size()
    }

    /// Returns the integer of the sample at the beginning of some bytes.
    #[inline(always)]
    pub(crate) fn read(self, bytes: &[u8]) -> i64 {
        match self.scale {
            None => read(self.sample, bytes),
            Some(scale) => (read_float(self.sample, bytes) * power(scale)) as i64,
        }
    }

    /// Reads samples, each `width` bytes after the one before.
    pub(crate) fn read_all<T: Lane>(self, bytes: &[u8], width: usize, numbers: &mut [T]) {
        #[inline(always)]
        fn each<T, const N: usize>(
            bytes: &[u8],
            width: usize,
            numbers: &mut [T],
            number: impl Fn(&[u8; N]) -> T,
        ) {
            if width == N {
                let all = numbers.iter_mut().zip(bytes.as_chunks::<N>().0);
                return all.for_each(|(to, bytes)| *to = number(bytes));
            }
            for (to, bytes) in numbers.iter_mut().zip(bytes.chunks(width)) {
                if let Some(bytes) = bytes.first_chunk() {
                    *to = number(bytes);
                }
            }
        }
        match (self.sample, self.scale) {
            (SampleType::U8, _) => {
                each(bytes, width, numbers, |bytes: &[u8; 1]| T::from_i64(bytes[0].into()))
            }
            (SampleType::I16, _) => {
                each(bytes, width, numbers, |bytes| T::from_i64(i16::from_le_bytes(*bytes).into()))
            }
            (SampleType::U16, _) => {
                each(bytes, width, numbers, |bytes| T::from_i64(u16::from_le_bytes(*bytes).into()))
            }
            (SampleType::F32, None) => {
                each(bytes, width, numbers, |bytes: &[u8; 4]| T::from_i64(read(SampleType::F32, bytes)))
            }
            _ => {
                for (to, bytes) in numbers.iter_mut().zip(bytes.chunks(width)) {
                    *to = T::from_i64(self.read(bytes));
                }
            }
        }
    }

    /// Writes samples, each `width` bytes after the one before.
    #[inline(always)]
    pub(crate) fn write_all(self, numbers: impl Iterator<Item = i64>, bytes: &mut [u8], width: usize) {
        let Some(scale) = self.scale else { return write_all(self.sample, numbers, bytes, width) };
        // (Powers of two: products are exact, unless the sample type has too few digits.)
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

/// Returns a power of two.
fn power(exponent: i8) -> f64 {
    f64::from_bits(((1023 + i64::from(exponent)) as u64) << 52)
}

/// Reads the floating sample at the beginning of some bytes.
#[inline(always)]
pub(crate) fn read_float(sample: SampleType, bytes: &[u8]) -> f64 {
    match (sample, bytes.first_chunk(), bytes.first_chunk()) {
        (SampleType::F32, Some(bytes), _) => f64::from(f32::from_le_bytes(*bytes)),
        (SampleType::F64, _, Some(bytes)) => f64::from_le_bytes(*bytes),
        _ => 0.0,
    }
}

/// Returns the exponents, as powers of two, of the lowest and the highest binary digit of some
/// numbers. Returns `None` if one is not finite, or is a negative zero, which is no integer.
fn digits(numbers: impl Iterator<Item = f64>) -> Option<(i32, i32)> {
    let (mut lowest, mut highest) = (i32::MAX, i32::MIN);
    for number in numbers {
        let bits = number.to_bits();
        let (exponent, fraction) = ((bits >> 52 & 0x7ff) as i32, bits & ((1 << 52) - 1));
        if !number.is_finite() || bits == (-0.0f64).to_bits() {
            return None;
        }
        if bits != 0 {
            // (Subnormal numbers have no leading digit, but they are far below all scales.)
            let fraction = fraction | 1 << 52;
            lowest = lowest.min(exponent - 1075 + fraction.trailing_zeros() as i32);
            highest = highest.max(exponent - 1023);
        }
    }
    Some(if lowest == i32::MAX { (0, 0) } else { (lowest, highest) })
}

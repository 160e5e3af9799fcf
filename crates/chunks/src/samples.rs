//! Sample formats of TIFF files, and their conversion to Spinney's types.

use serde::{Deserialize, Serialize};
use spinney_base::value::SampleType;

use crate::spec::sample_format::{COMPLEX_FLOAT, COMPLEX_SIGNED, FLOAT, SIGNED, UNDEFINED, UNSIGNED};

/// Sample format of a file, with its number of bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SampleFormat {
    /// Unsigned integers.
    Uint(u8),
    /// Integers in two's complement.
    Int(u8),
    /// Floating-point numbers.
    Float(u8),
}

impl SampleFormat {
    /// The format for the tags SampleFormat and BitsPerSample.
    ///
    /// # Errors
    /// Names an unsupported format.
    pub fn new(format: u64, bits: u64) -> Result<SampleFormat, String> {
        match (format, bits) {
            // Readers treat "undefined" as unsigned.
            (UNSIGNED | UNDEFINED, 1..=32 | 64) => Ok(SampleFormat::Uint(bits as u8)),
            (SIGNED, 8 | 16 | 32 | 64) => Ok(SampleFormat::Int(bits as u8)),
            (FLOAT, 16 | 24 | 32 | 64) => Ok(SampleFormat::Float(bits as u8)),
            (COMPLEX_SIGNED | COMPLEX_FLOAT, _) => Err(format!("a raster of complex samples ({bits} bits)")),
            _ => Err(format!("a raster of samples of {bits} bits in format {format}")),
        }
    }

    /// Checks a format of unknown origin: [`SampleFormat::new`] must accept it.
    pub(crate) fn check(self) -> Result<(), String> {
        let format = match self {
            SampleFormat::Uint(_) => UNSIGNED,
            SampleFormat::Int(_) => SIGNED,
            SampleFormat::Float(_) => FLOAT,
        };
        SampleFormat::new(format, self.bits() as u64).map(drop)
    }

    /// Bits of a sample.
    pub fn bits(self) -> usize {
        let (SampleFormat::Uint(bits) | SampleFormat::Int(bits) | SampleFormat::Float(bits)) = self;
        bits.into()
    }

    /// Bytes of a sample; `None` if samples are bit-packed, so that byte order and predictors do
    /// not apply. That includes 24-bit integers: their most significant byte comes first in any
    /// file.
    pub(crate) fn bytes(self) -> Option<usize> {
        match self {
            SampleFormat::Uint(24) => None,
            _ => self.bits().is_multiple_of(8).then_some(self.bits() / 8),
        }
    }

    /// The type that holds all such samples.
    pub fn sample(self) -> SampleType {
        match self {
            SampleFormat::Uint(1..=8) => SampleType::U8,
            SampleFormat::Uint(9..=16) => SampleType::U16,
            SampleFormat::Uint(17..=32) => SampleType::U32,
            SampleFormat::Int(8) => SampleType::I8,
            SampleFormat::Int(16) => SampleType::I16,
            SampleFormat::Int(32) => SampleType::I32,
            SampleFormat::Uint(_) => SampleType::U64,
            SampleFormat::Int(_) => SampleType::I64,
            SampleFormat::Float(16 | 24 | 32) => SampleType::F32,
            _ => SampleType::F64,
        }
    }

    /// Name of the format, such as "uint12".
    pub fn name(self) -> String {
        match self {
            SampleFormat::Uint(bits) => format!("uint{bits}"),
            SampleFormat::Int(bits) => format!("int{bits}"),
            SampleFormat::Float(16) => "half".into(),
            SampleFormat::Float(bits) => format!("float{bits}"),
        }
    }

    /// Unpacks samples of a row from sample `first` on, until `out` is full. Byte-aligned samples
    /// are little-endian.
    pub fn widen(self, row: &[u8], first: usize, out: &mut [u8]) {
        let count = out.len() / self.sample().size();
        let row = match self.bytes() {
            Some(size) => &row[first * size..(first + count) * size],
            None => row,
        };
        match self {
            SampleFormat::Uint(8 | 16 | 32 | 64)
            | SampleFormat::Int(8 | 16 | 32 | 64)
            | SampleFormat::Float(32 | 64) => out.copy_from_slice(row),
            SampleFormat::Float(16) => {
                each(row, out, |half| half::f16::from_le_bytes(half).to_f32().to_le_bytes());
            }
            SampleFormat::Float(24) => each(row, out, |[a, b, c]| float24(a, b, c).to_le_bytes()),
            SampleFormat::Uint(bits) => unpack(row, bits.into(), first, out),
            SampleFormat::Int(_) | SampleFormat::Float(_) => unreachable!("refused by SampleFormat::new"),
        }
    }
}

/// Maps samples of `N` bytes to samples of `M` bytes.
fn each<const N: usize, const M: usize>(row: &[u8], out: &mut [u8], map: impl Fn([u8; N]) -> [u8; M]) {
    for (from, to) in row.as_chunks::<N>().0.iter().zip(out.as_chunks_mut::<M>().0) {
        *to = map(*from);
    }
}

/// Decodes a 24-bit float of 1 sign, 7 exponent and 16 mantissa bits, given from its lowest byte.
fn float24(a: u8, b: u8, c: u8) -> f32 {
    let bits = u32::from_le_bytes([a, b, c, 0]);
    let (sign, exponent, mantissa) = (bits >> 23, bits >> 16 & 0x7f, bits & 0xffff);
    let magnitude = match exponent {
        // Subnormal numbers, below 2^-62; f32 represents all of them.
        0 => mantissa as f32 * 2f32.powi(-62 - 16),
        0x7f => f32::from_bits(0xff << 23 | mantissa << 7),
        _ => f32::from_bits((exponent + 127 - 63) << 23 | mantissa << 7),
    };
    f32::from_bits(magnitude.to_bits() | sign << 31)
}

/// Unpacks samples of 1 to 31 bits, packed from the highest bit of each byte down.
fn unpack(row: &[u8], bits: usize, first: usize, out: &mut [u8]) {
    match bits {
        1 | 2 | 4 => {
            let mask = (1u8 << bits) - 1;
            for (i, to) in out.iter_mut().enumerate() {
                let bit = (first + i) * bits;
                *to = row[bit / 8] >> (8 - bits - bit % 8) & mask;
            }
        }
        _ => {
            let size = bits.div_ceil(8).next_power_of_two();
            for (i, to) in out.chunks_exact_mut(size).enumerate() {
                let bit = (first + i) * bits;
                let bytes = &row[bit / 8..(bit + bits).div_ceil(8)];
                let joined = bytes.iter().fold(0u64, |n, byte| n << 8 | *byte as u64);
                let value = joined >> (bytes.len() * 8 - bit % 8 - bits) & ((1 << bits) - 1);
                to.copy_from_slice(&value.to_le_bytes()[..size]);
            }
        }
    }
}

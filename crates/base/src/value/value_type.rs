//! Value types of trees, known at run time.

use serde::{Deserialize, Serialize};

/// Type of one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[allow(missing_docs)] // the names say it
pub enum SampleType {
    U8,
    U16,
    I16,
    U32,
    I32,
    F32,
    F64,
    I8,
    U64,
    I64,
}

impl SampleType {
    /// All types, in the order of their numbers on disk.
    pub const ALL: [SampleType; 10] = {
        use SampleType::*;
        [U8, U16, I16, U32, I32, F32, F64, I8, U64, I64]
    };

    /// Returns the size of a sample in bytes.
    #[inline]
    pub const fn size(self) -> usize {
        [1, 2, 2, 4, 4, 4, 8, 1, 8, 8][self as usize]
    }

    /// Returns the type's name, as in Rust.
    pub const fn name(self) -> &'static str {
        ["u8", "u16", "i16", "u32", "i32", "f32", "f64", "i8", "u64", "i64"][self as usize]
    }

    /// Whether samples are floating-point numbers.
    #[inline]
    pub const fn is_float(self) -> bool {
        matches!(self, SampleType::F32 | SampleType::F64)
    }

    /// Whether samples are 64-bit integers, which are not all exact in an f64.
    #[inline]
    pub const fn is_wide_integer(self) -> bool {
        matches!(self, SampleType::U64 | SampleType::I64)
    }
}

/// Type of a tree's values: a number of samples of one type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct ValueType {
    /// Type of each sample.
    pub sample: SampleType,
    /// Number of samples per value, 1 to 4.
    pub channels: u8,
    /// Representation of missing samples, which sums, means and extremes skip.
    pub mask: Mask,
}

/// How cells of several channels indicate missing samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Mask {
    /// No sample is missing: a cell has all of them, or is VOID.
    #[default]
    None,
    /// This sample (its bytes, padded with zeros) is the nodata value of each channel.
    Missing([u8; 8]),
    /// The last channel is opacity. If it is 0 the cell is transparent: its colours are stored, but
    /// do not count.
    Alpha,
}

impl ValueType {
    /// Creates the type of values with `channels` samples of a type.
    #[inline]
    pub const fn new(sample: SampleType, channels: u8) -> ValueType {
        ValueType { sample, channels, mask: Mask::None }
    }

    /// Whether trees can have such values: 1 to 4 channels of u8, u16 or f32, or 1 channel of any
    /// type.
    pub const fn is_supported(self) -> bool {
        match self.sample {
            SampleType::U8 | SampleType::U16 | SampleType::F32 => 0 < self.channels && self.channels <= 4,
            _ => self.channels == 1,
        }
    }

    /// Returns the size of a value in bytes.
    #[inline]
    pub const fn size(self) -> usize {
        self.sample.size() * self.channels as usize
    }
}

impl std::fmt::Display for ValueType {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.sample.name())?;
        if self.channels > 1 { write!(f, "x{}", self.channels) } else { Ok(()) }
    }
}

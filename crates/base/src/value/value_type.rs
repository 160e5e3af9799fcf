//! The type of a tree's values, known at run time.

use serde::{Deserialize, Serialize};

/// The type of one sample.
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

    /// Bytes of one sample.
    #[inline]
    pub const fn size(self) -> usize {
        [1, 2, 2, 4, 4, 4, 8, 1, 8, 8][self as usize]
    }

    /// The type's name, as Rust spells it.
    pub const fn name(self) -> &'static str {
        ["u8", "u16", "i16", "u32", "i32", "f32", "f64", "i8", "u64", "i64"][self as usize]
    }

    /// Whether samples are floating-point numbers.
    #[inline]
    pub const fn is_float(self) -> bool {
        matches!(self, SampleType::F32 | SampleType::F64)
    }

    /// Whether samples are integers that an f64 cannot all be: of 64 bits.
    #[inline]
    pub const fn is_wide_integer(self) -> bool {
        matches!(self, SampleType::U64 | SampleType::I64)
    }
}

/// The type of a tree's values: so many samples of one type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct ValueType {
    /// Type of each sample.
    pub sample: SampleType,
    /// Samples of one value, 1 to 4.
    pub channels: u8,
    /// Which cells lack samples: sums, means and extremes leave these out.
    pub mask: Mask,
}

/// How cells of several channels say that they lack samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Mask {
    /// No cell does: it has all of them, or is VOID.
    #[default]
    None,
    /// This sample (its bytes, then zeros) means that there is none in a channel.
    Missing([u8; 8]),
    /// The last channel is opacity. Where it is 0 the cell is transparent: its colours are kept, and count for nothing.
    Alpha,
}

impl ValueType {
    /// The type of values with so many samples of a type.
    #[inline]
    pub const fn new(sample: SampleType, channels: u8) -> ValueType {
        ValueType { sample, channels, mask: Mask::None }
    }

    /// Whether trees can have such values: 1 to 4 channels of u8, u16 or f32, or 1 channel of any type.
    pub const fn is_supported(self) -> bool {
        match self.sample {
            SampleType::U8 | SampleType::U16 | SampleType::F32 => 0 < self.channels && self.channels <= 4,
            _ => self.channels == 1,
        }
    }

    /// Bytes of one value.
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

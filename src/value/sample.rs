//! Sample types, and values made of one to four samples.

use std::cmp::Ordering;
use std::fmt::Debug;
use std::ops::Add;

use serde::{Deserialize, Serialize};
use zerocopy::little_endian::{F32, F64, I16, I32, U16, U32};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

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
}

impl SampleType {
    /// All types, in the order of their numbers on disk.
    pub const ALL: [SampleType; 7] = {
        use SampleType::*;
        [U8, U16, I16, U32, I32, F32, F64]
    };

    /// Bytes of one sample.
    pub fn size(self) -> usize {
        [1, 2, 2, 4, 4, 4, 8][self as usize]
    }

    /// The type's name, as Rust spells it.
    pub fn name(self) -> &'static str {
        ["u8", "u16", "i16", "u32", "i32", "f32", "f64"][self as usize]
    }

    /// Whether samples are floating-point numbers.
    pub fn is_float(self) -> bool {
        matches!(self, SampleType::F32 | SampleType::F64)
    }
}

/// The type of a tree's values: so many samples of one type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct ValueType {
    /// Type of each sample.
    pub sample: SampleType,
    /// Samples of one value, 1 to 4.
    pub channels: u8,
}

impl ValueType {
    /// Bytes of one value.
    pub fn size(self) -> usize {
        self.sample.size() * self.channels as usize
    }
}

impl std::fmt::Display for ValueType {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.sample.name())?;
        if self.channels > 1 { write!(f, "x{}", self.channels) } else { Ok(()) }
    }
}

/// Sums of samples: exact (i64, then i128) for integers, f64 for floating samples.
pub trait Sum: Copy + Debug + Default + PartialEq + Add<Output = Self> + Send + Sync + 'static {
    /// As f64, rounded once.
    fn to_f64(self) -> f64;
    /// 16 bytes for the disk: i128, or f64 and eight zeros.
    fn to_bytes(self) -> [u8; 16];
    /// Inverse of [`Sum::to_bytes`].
    fn from_bytes(bytes: [u8; 16]) -> Self;
    /// The sum of `cells` equal samples whose own sum is this.
    fn times(self, cells: u64) -> Self;
    /// Variance of the population from its sum, sum of squares and size.
    fn variance(sum: Self, squares: Self, cells: u64) -> f64;
}

impl Sum for i128 {
    fn to_f64(self) -> f64 {
        self as f64
    }
    fn to_bytes(self) -> [u8; 16] {
        self.to_le_bytes()
    }
    fn from_bytes(bytes: [u8; 16]) -> Self {
        i128::from_le_bytes(bytes)
    }
    fn times(self, cells: u64) -> Self {
        self.wrapping_mul(cells as i128)
    }
    fn variance(sum: i128, squares: i128, cells: u64) -> f64 {
        // Exact until the last division, where the numbers are not beyond all bounds.
        let exact = squares.checked_mul(cells as i128).zip(sum.checked_mul(sum)).map(|(a, b)| (a - b) as f64);
        let n = cells as f64;
        exact.map_or_else(|| f64::variance(sum as f64, squares as f64, cells), |exact| exact / (n * n))
    }
}

impl Sum for f64 {
    fn to_f64(self) -> f64 {
        self
    }
    fn to_bytes(self) -> [u8; 16] {
        let mut bytes = [0; 16];
        bytes[..8].copy_from_slice(&if self.is_nan() { f64::NAN } else { self }.to_le_bytes());
        bytes
    }
    fn from_bytes(bytes: [u8; 16]) -> Self {
        f64::from_le_bytes(bytes[..8].try_into().unwrap())
    }
    fn times(self, cells: u64) -> Self {
        self * cells as f64
    }
    fn variance(sum: f64, squares: f64, cells: u64) -> f64 {
        let n = cells as f64;
        ((squares - sum / n * sum) / n).max(0.0)
    }
}

/// One number of a value.
pub trait Sample: Copy + Debug + Default + PartialEq + PartialOrd + Send + Sync + 'static {
    /// The type as a run-time value.
    const TYPE: SampleType;
    /// How it stands on disk: little-endian at any address.
    type Wire: FromBytes + IntoBytes + Unaligned + Immutable + KnownLayout + Copy + Debug + Send + Sync;
    /// Sum over one block of cells (at most 2^18), without overflow, and twice it.
    type BlockSum: Copy + Debug + Default + Add<Output = Self::BlockSum> + Into<Self::TotalSum> + Send + Sync;
    /// Sum of squares over one block of cells, without overflow.
    type BlockSquare: Copy
        + Debug
        + Default
        + Add<Output = Self::BlockSquare>
        + Into<Self::TotalSum>
        + Send
        + Sync;
    /// Sum over any number of cells, and of squares.
    type TotalSum: Sum;

    /// From disk.
    fn from_wire(wire: Self::Wire) -> Self;
    /// To disk.
    fn to_wire(self) -> Self::Wire;
    /// The number as f64, exactly (all types fit).
    fn to_f64(self) -> f64;
    /// The sample equal to this number, if there is one.
    fn from_f64(number: f64) -> Option<Self>;
    /// The sample nearest to this number.
    fn from_f64_lossy(number: f64) -> Self;
    /// The sum of `cells` equal samples (at most 2^18).
    fn block_sum(self, cells: u32) -> Self::BlockSum;
    /// The sum of the squares of `cells` equal samples (at most 2^18).
    fn block_square(self, cells: u32) -> Self::BlockSquare;
    /// The sample as a sum of one.
    fn total_sum(self) -> Self::TotalSum;
    /// The square, for variances.
    fn square(self) -> Self::TotalSum;
    /// Mean of `cells` samples, rounded to the type.
    fn mean(sum: Self::TotalSum, cells: u64) -> Self;
    /// Mean of at most 2^18 samples, rounded to the type.
    fn block_mean(sum: Self::BlockSum, cells: u32) -> Self;
    /// A total order: by number, then (for floats) by bits, as `f64::total_cmp`.
    fn order(self, other: Self) -> Ordering;
    /// Equal in every bit: `0.0` and `-0.0` differ.
    fn same(self, other: Self) -> bool;
    /// Not a number.
    fn is_nan(self) -> bool;
}

macro_rules! integer_sample {
    ($type:ident, $variant:ident, $wire:ty, $sum:ty, $square:ty, $to:expr, $from:expr) => {
        impl Sample for $type {
            const TYPE: SampleType = SampleType::$variant;
            type Wire = $wire;
            type BlockSum = $sum;
            type BlockSquare = $square;
            type TotalSum = i128;

            #[inline]
            fn from_wire(wire: $wire) -> $type {
                $from(wire)
            }
            #[inline]
            fn to_wire(self) -> $wire {
                $to(self)
            }
            fn to_f64(self) -> f64 {
                self as f64
            }
            fn from_f64_lossy(number: f64) -> $type {
                number as $type
            }
            fn from_f64(number: f64) -> Option<$type> {
                (number as $type as f64 == number).then_some(number as $type)
            }
            #[inline]
            fn block_sum(self, cells: u32) -> $sum {
                self as $sum * cells as $sum
            }
            #[inline]
            fn block_square(self, cells: u32) -> $square {
                self as $square * self as $square * cells as $square
            }
            #[inline]
            fn total_sum(self) -> i128 {
                self as i128
            }
            #[inline]
            fn square(self) -> i128 {
                let wide = self as i64 as i128;
                wide * wide
            }
            fn mean(sum: i128, cells: u64) -> $type {
                let cells = cells as i128;
                (2 * sum + cells).div_euclid(2 * cells) as $type
            }
            #[inline]
            fn block_mean(sum: $sum, cells: u32) -> $type {
                let twice = 2 * cells as $sum;
                let half_up = 2 * sum + cells as $sum;
                if cells.is_power_of_two() {
                    (half_up >> twice.trailing_zeros()) as $type
                } else {
                    half_up.div_euclid(twice) as $type
                }
            }
            fn order(self, other: $type) -> Ordering {
                self.cmp(&other)
            }
            #[inline]
            fn same(self, other: $type) -> bool {
                self == other
            }
            #[inline]
            fn is_nan(self) -> bool {
                false
            }
        }
    };
}

integer_sample!(u8, U8, u8, i32, i64, |x| x, |x| x);
integer_sample!(u16, U16, U16, i64, i64, U16::new, |x: U16| x.get());
integer_sample!(i16, I16, I16, i64, i64, I16::new, |x: I16| x.get());
integer_sample!(u32, U32, U32, i64, i128, U32::new, |x: U32| x.get());
integer_sample!(i32, I32, I32, i64, i128, I32::new, |x: I32| x.get());

macro_rules! float_sample {
    ($type:ident, $variant:ident, $wire:ty) => {
        impl Sample for $type {
            const TYPE: SampleType = SampleType::$variant;
            type Wire = $wire;
            type BlockSum = f64;
            type BlockSquare = f64;
            type TotalSum = f64;

            #[inline]
            fn from_wire(wire: $wire) -> $type {
                wire.get()
            }
            #[inline]
            fn to_wire(self) -> $wire {
                <$wire>::new(self)
            }
            fn to_f64(self) -> f64 {
                self as f64
            }
            fn from_f64_lossy(number: f64) -> $type {
                number as $type
            }
            fn from_f64(number: f64) -> Option<$type> {
                (number as $type as f64 == number).then_some(number as $type)
            }
            #[inline]
            fn block_sum(self, cells: u32) -> f64 {
                self as f64 * cells as f64
            }
            #[inline]
            fn block_square(self, cells: u32) -> f64 {
                self as f64 * self as f64 * cells as f64
            }
            #[inline]
            fn total_sum(self) -> f64 {
                self as f64
            }
            #[inline]
            fn square(self) -> f64 {
                self as f64 * self as f64
            }
            #[inline]
            fn mean(sum: f64, cells: u64) -> $type {
                let mean = (sum / cells as f64) as $type;
                // One bit pattern for "not a number" (from infinities of both signs), so that files are
                // the same everywhere.
                if mean.is_nan() { $type::NAN } else { mean }
            }
            #[inline]
            fn block_mean(sum: f64, cells: u32) -> $type {
                Self::mean(sum, cells as u64)
            }
            fn order(self, other: $type) -> Ordering {
                self.total_cmp(&other)
            }
            #[inline]
            fn same(self, other: $type) -> bool {
                self.to_bits() == other.to_bits()
            }
            #[inline]
            fn is_nan(self) -> bool {
                $type::is_nan(self)
            }
        }
    };
}

float_sample!(f32, F32, F32);
float_sample!(f64, F64, F64);

/// A tree's value: one to four samples of one type.
pub trait Value: Copy + Debug + Default + PartialEq + Send + Sync + 'static {
    /// Type of each sample.
    type Sample: Sample;
    /// Number of samples.
    const CHANNELS: usize;
    /// How it stands on disk.
    type Wire: FromBytes + IntoBytes + Unaligned + Immutable + KnownLayout + Copy + Debug + Send + Sync;
    /// Sums of a block, one per channel.
    type BlockSums: Copy + Debug + Default + Send + Sync;
    /// Sums of squares of a block, one per channel.
    type BlockSquares: Copy + Debug + Default + Send + Sync;

    /// The type as a run-time value.
    const TYPE: ValueType = ValueType { sample: Self::Sample::TYPE, channels: Self::CHANNELS as u8 };

    /// The samples.
    fn samples(&self) -> &[Self::Sample];
    /// Makes a value from a function of the channel.
    fn from_channels(sample: impl FnMut(usize) -> Self::Sample) -> Self;
    /// From disk.
    fn from_wire(wire: Self::Wire) -> Self;
    /// To disk.
    fn to_wire(self) -> Self::Wire;
    /// Sums of any number of cells, one per channel.
    type TotalSums: Copy
        + Debug
        + Default
        + PartialEq
        + AsRef<[<Self::Sample as Sample>::TotalSum]>
        + AsMut<[<Self::Sample as Sample>::TotalSum]>
        + Send
        + Sync;

    /// Sums of `cells` cells of this value (at most 2^18).
    fn block_sums(self, cells: u32) -> Self::BlockSums;
    /// Adds channel by channel.
    fn add_block_sums(a: Self::BlockSums, b: Self::BlockSums) -> Self::BlockSums;
    /// Sums of the squares of `cells` cells of this value (at most 2^18).
    fn block_squares(self, cells: u32) -> Self::BlockSquares;
    /// Adds channel by channel.
    fn add_block_squares(a: Self::BlockSquares, b: Self::BlockSquares) -> Self::BlockSquares;
    /// The sums of a block as sums of any number of cells.
    fn widen(sums: Self::BlockSums) -> Self::TotalSums;
    /// The same for sums of squares.
    fn widen_squares(squares: Self::BlockSquares) -> Self::TotalSums;
    /// Means of at most 2^18 cells, rounded to the type.
    fn block_mean(sums: Self::BlockSums, cells: u32) -> Self;
    /// Adds channel by channel.
    fn add_sums(a: Self::TotalSums, b: Self::TotalSums) -> Self::TotalSums;
    /// Equal in every bit.
    fn same(self, other: Self) -> bool;

    /// A total order: channel after channel.
    fn order(self, other: Self) -> Ordering {
        let pairs = self.samples().iter().zip(other.samples());
        pairs.map(|(a, b)| a.order(*b)).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
    }

    /// Whether any sample is not a number; such a value is VOID.
    #[inline]
    fn is_nan(self) -> bool {
        self.samples().iter().any(|sample| sample.is_nan())
    }

    /// The value whose every sample is this number, if the type can hold it.
    fn splat_f64(number: f64) -> Option<Self> {
        Self::Sample::from_f64(number).map(|sample| Self::from_channels(|_| sample))
    }
}

macro_rules! values {
    ($($channels:literal)*) => { $(
        impl<S: Sample> Value for [S; $channels] {
            type Sample = S;
            const CHANNELS: usize = $channels;
            type Wire = [S::Wire; $channels];
            type BlockSums = [S::BlockSum; $channels];
            type BlockSquares = [S::BlockSquare; $channels];
            type TotalSums = [S::TotalSum; $channels];

            #[inline]
            fn samples(&self) -> &[S] {
                self
            }
            #[inline]
            fn from_channels(sample: impl FnMut(usize) -> S) -> Self {
                std::array::from_fn(sample)
            }
            #[inline]
            fn from_wire(wire: Self::Wire) -> Self {
                wire.map(S::from_wire)
            }
            #[inline]
            fn to_wire(self) -> Self::Wire {
                self.map(S::to_wire)
            }
            #[inline]
            fn block_sums(self, cells: u32) -> Self::BlockSums {
                self.map(|sample| sample.block_sum(cells))
            }
            #[inline]
            fn add_block_sums(a: Self::BlockSums, b: Self::BlockSums) -> Self::BlockSums {
                std::array::from_fn(|c| a[c] + b[c])
            }
            #[inline]
            fn block_squares(self, cells: u32) -> Self::BlockSquares {
                self.map(|sample| sample.block_square(cells))
            }
            #[inline]
            fn add_block_squares(a: Self::BlockSquares, b: Self::BlockSquares) -> Self::BlockSquares {
                std::array::from_fn(|c| a[c] + b[c])
            }
            fn widen(sums: Self::BlockSums) -> Self::TotalSums {
                sums.map(Into::into)
            }
            fn widen_squares(squares: Self::BlockSquares) -> Self::TotalSums {
                squares.map(Into::into)
            }
            #[inline]
            fn block_mean(sums: Self::BlockSums, cells: u32) -> Self {
                sums.map(|sum| S::block_mean(sum, cells))
            }
            fn add_sums(a: Self::TotalSums, b: Self::TotalSums) -> Self::TotalSums {
                std::array::from_fn(|c| a[c] + b[c])
            }
            #[inline]
            fn same(self, other: Self) -> bool {
                (0..$channels).all(|c| self[c].same(other[c]))
            }
        }
    )* };
}

values!(1 2 3 4);

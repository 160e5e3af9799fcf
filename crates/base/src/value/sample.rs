//! Samples and values whose type is known at compile time: for kernels, which work on many values at once.

use std::cmp::Ordering;
use std::fmt::Debug;
use std::ops::Add;

use zerocopy::little_endian::{F32, F64, I16, I32, U16, U32};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::double::DoubleDouble;
use super::sums::Sums;
use super::value_type::{SampleType, ValueType};

/// Sums of any number of samples: exact (i128) for integers, double-double for floating samples.
pub trait TotalSum: Copy + Debug + Default + Add<Output = Self> + Send + Sync + 'static {
    /// One sum per channel, at most four.
    fn to_sums(sums: &[Self]) -> Sums;
    /// The inverse; sums of the other kind are zeros.
    fn from_sums(sums: &Sums) -> [Self; 4];
}

impl TotalSum for i128 {
    fn to_sums(sums: &[i128]) -> Sums {
        Sums::Exact(std::array::from_fn(|channel| sums.get(channel).copied().unwrap_or(0)))
    }

    fn from_sums(sums: &Sums) -> [i128; 4] {
        if let Sums::Exact(sums) = sums { *sums } else { [0; 4] }
    }
}

impl TotalSum for DoubleDouble {
    fn to_sums(sums: &[DoubleDouble]) -> Sums {
        Sums::Float(std::array::from_fn(|channel| sums.get(channel).copied().unwrap_or_default()))
    }

    fn from_sums(sums: &Sums) -> [DoubleDouble; 4] {
        if let Sums::Float(sums) = sums { *sums } else { Default::default() }
    }
}

/// One number of a value.
pub trait Sample: Copy + Debug + Default + PartialEq + PartialOrd + Send + Sync + 'static {
    /// The type as a run-time value.
    const TYPE: SampleType;

    /// The sample that the first bytes of a slice are, little-endian.
    fn read(bytes: &[u8]) -> Self;
    /// Writes the sample's bytes, little-endian.
    fn write(self, bytes: &mut [u8]);
    /// The number as f64, exactly (all types fit).
    fn to_f64(self) -> f64;
    /// The sample equal to this number, if there is one.
    fn from_f64(number: f64) -> Option<Self>;
    /// The sample nearest to this number.
    fn from_f64_lossy(number: f64) -> Self;
    /// A number that orders samples: by number, then (for floats) by bits, as `f64::total_cmp`.
    fn order_key(self) -> u64;
}

/// Wire form, sums and means of samples, for kernels.
pub trait Arithmetic: Sample {
    /// Form on disk: little-endian at any address.
    type Wire: FromBytes + IntoBytes + Unaligned + Immutable + KnownLayout + Copy + Debug + Send + Sync;
    /// Sum over at most 2^15 cells, without overflow, in as few bytes as possible.
    type NarrowSum: Copy
        + Debug
        + Default
        + Add<Output = Self::NarrowSum>
        + Into<Self::BlockSum>
        + Send
        + Sync;
    /// Sum over one block of cells (at most 2^24), without overflow.
    type BlockSum: Copy + Debug + Default + Add<Output = Self::BlockSum> + Into<Self::TotalSum> + Send + Sync;
    /// Sum of squares over at most 2^15 cells, without overflow, in as few bytes as possible.
    type NarrowSquare: Copy
        + Debug
        + Default
        + Add<Output = Self::NarrowSquare>
        + Into<Self::BlockSquare>
        + Send
        + Sync;
    /// Sum of squares over one block of cells, without overflow.
    type BlockSquare: Copy
        + Debug
        + Default
        + Add<Output = Self::BlockSquare>
        + Into<Self::TotalSum>
        + Send
        + Sync;
    /// Sum over any number of cells, and of squares.
    type TotalSum: TotalSum;

    /// From disk.
    fn from_wire(wire: Self::Wire) -> Self;
    /// To disk.
    fn to_wire(self) -> Self::Wire;
    /// The sum of one sample.
    fn narrow_sum(self) -> Self::NarrowSum;
    /// The square of one sample.
    fn narrow_square(self) -> Self::NarrowSquare;
    /// Mean of 2^`bits` samples (at most 2^15), rounded to the type.
    fn narrow_mean(sum: Self::NarrowSum, bits: u32) -> Self;
    /// The sum of `cells` equal samples (at most 2^24).
    fn block_sum(self, cells: u32) -> Self::BlockSum;
    /// The sum of the squares of `cells` equal samples (at most 2^24).
    fn block_square(self, cells: u32) -> Self::BlockSquare;
    /// The sum of any number of equal samples.
    fn total_sum(self, cells: u64) -> Self::TotalSum;
    /// The sum of the squares of any number of equal samples.
    fn total_square(self, cells: u64) -> Self::TotalSum;
    /// Mean of at most 2^24 samples, rounded to the type.
    fn block_mean(sum: Self::BlockSum, cells: u32) -> Self;
    /// Mean of any number of samples, rounded to the type.
    fn mean(sum: Self::TotalSum, cells: u64) -> Self;
    /// A total order: by number, then (for floats) by bits, as `f64::total_cmp`.
    fn order(self, other: Self) -> Ordering;
    /// Not a number.
    fn is_nan(self) -> bool;
}

macro_rules! integer_sample {
    ($type:ident, $variant:ident, $wire:ty, $narrow:ty, $narrow_square:ty, $sum:ty, $square:ty, $flip:literal, $to:expr, $from:expr) => {
        impl Sample for $type {
            const TYPE: SampleType = SampleType::$variant;

            #[inline]
            fn read(bytes: &[u8]) -> $type {
                $type::from_le_bytes(bytes[..size_of::<$type>()].try_into().expect("as many bytes"))
            }
            #[inline]
            fn write(self, bytes: &mut [u8]) {
                bytes[..size_of::<$type>()].copy_from_slice(&self.to_le_bytes());
            }
            #[inline]
            fn to_f64(self) -> f64 {
                self as f64
            }
            #[inline]
            fn from_f64(number: f64) -> Option<$type> {
                (number as $type as f64 == number).then_some(number as $type)
            }
            #[inline]
            fn from_f64_lossy(number: f64) -> $type {
                number as $type
            }
            #[inline]
            fn order_key(self) -> u64 {
                // The lowest number of a signed type becomes 0.
                let bits = 8 * size_of::<$type>() as u32;
                (self as i64 as u64).wrapping_add($flip << (bits - 1)) & (u64::MAX >> (64 - bits))
            }
        }

        impl Arithmetic for $type {
            type Wire = $wire;
            type NarrowSum = $narrow;
            type NarrowSquare = $narrow_square;
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
            #[inline]
            fn narrow_sum(self) -> $narrow {
                self as $narrow
            }
            #[inline]
            fn narrow_square(self) -> $narrow_square {
                self as $narrow_square * self as $narrow_square
            }
            #[inline]
            fn narrow_mean(sum: $narrow, bits: u32) -> $type {
                // Rounded half up: see `block_mean`.
                ((sum + (1 << bits >> 1)) >> bits) as $type
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
            fn total_sum(self, cells: u64) -> i128 {
                (self as i128).wrapping_mul(cells as i128)
            }
            #[inline]
            fn total_square(self, cells: u64) -> i128 {
                let wide = self as i64 as i128;
                (wide * wide).wrapping_mul(cells as i128)
            }
            #[inline]
            fn block_mean(sum: $sum, cells: u32) -> $type {
                // Rounded half up: floor((2 sum + cells) / (2 cells)). A shift rounds down for negative
                // numbers, too. No overflow: the sum of 2^24 samples of 32 bits has 56.
                let (twice, half_up) = (2 * i64::from(cells), 2 * i64::from(sum) + i64::from(cells));
                if cells.is_power_of_two() {
                    (half_up >> twice.trailing_zeros()) as $type
                } else {
                    half_up.div_euclid(twice) as $type
                }
            }
            fn mean(sum: i128, cells: u64) -> $type {
                let cells = cells as i128;
                (2 * sum + cells).div_euclid(2 * cells) as $type
            }
            #[inline]
            fn order(self, other: $type) -> Ordering {
                self.cmp(&other)
            }
            #[inline]
            fn is_nan(self) -> bool {
                false
            }
        }
    };
}

integer_sample!(u8, U8, u8, u32, u32, u32, i64, 0u64, |x| x, |x| x);
integer_sample!(u16, U16, U16, u32, i64, i64, i64, 0u64, U16::new, |x: U16| x.get());
integer_sample!(i16, I16, I16, i32, i64, i64, i64, 1u64, I16::new, |x: I16| x.get());
integer_sample!(u32, U32, U32, i64, i128, i64, i128, 0u64, U32::new, |x: U32| x.get());
integer_sample!(i32, I32, I32, i64, i128, i64, i128, 1u64, I32::new, |x: I32| x.get());

macro_rules! float_sample {
    ($type:ident, $variant:ident, $wire:ty, $bits:ident, $square:expr) => {
        impl Sample for $type {
            const TYPE: SampleType = SampleType::$variant;

            #[inline]
            fn read(bytes: &[u8]) -> $type {
                $type::from_le_bytes(bytes[..size_of::<$type>()].try_into().expect("as many bytes"))
            }
            #[inline]
            fn write(self, bytes: &mut [u8]) {
                bytes[..size_of::<$type>()].copy_from_slice(&self.to_le_bytes());
            }
            #[inline]
            fn to_f64(self) -> f64 {
                self as f64
            }
            #[inline]
            fn from_f64(number: f64) -> Option<$type> {
                (number as $type as f64 == number).then_some(number as $type)
            }
            #[inline]
            fn from_f64_lossy(number: f64) -> $type {
                number as $type
            }
            #[inline]
            fn order_key(self) -> u64 {
                // Negative numbers have their bits the other way round, all below those of the others.
                let bits = self.to_bits();
                let sign = 1 << ($bits::BITS - 1);
                u64::from(if bits & sign == 0 { bits | sign } else { !bits })
            }
        }

        impl Arithmetic for $type {
            type Wire = $wire;
            type NarrowSum = DoubleDouble;
            type NarrowSquare = DoubleDouble;
            type BlockSum = DoubleDouble;
            type BlockSquare = DoubleDouble;
            type TotalSum = DoubleDouble;

            #[inline]
            fn from_wire(wire: $wire) -> $type {
                wire.get()
            }
            #[inline]
            fn to_wire(self) -> $wire {
                <$wire>::new(self)
            }
            #[inline]
            fn narrow_sum(self) -> DoubleDouble {
                DoubleDouble::from(f64::from(self))
            }
            #[inline]
            fn narrow_square(self) -> DoubleDouble {
                self.total_square(1)
            }
            #[inline]
            fn narrow_mean(sum: DoubleDouble, bits: u32) -> $type {
                Self::block_mean(sum, 1 << bits)
            }
            #[inline]
            fn block_sum(self, cells: u32) -> DoubleDouble {
                self.total_sum(cells.into())
            }
            #[inline]
            fn block_square(self, cells: u32) -> DoubleDouble {
                self.total_square(cells.into())
            }
            #[inline]
            fn total_sum(self, cells: u64) -> DoubleDouble {
                DoubleDouble::from(f64::from(self)).times(cells)
            }
            #[inline]
            fn total_square(self, cells: u64) -> DoubleDouble {
                let square: fn(f64) -> DoubleDouble = $square;
                square(f64::from(self)).times(cells)
            }
            #[inline]
            fn block_mean(sum: DoubleDouble, cells: u32) -> $type {
                Self::mean(sum, cells as u64)
            }
            #[inline]
            fn mean(sum: DoubleDouble, cells: u64) -> $type {
                let mean = (sum.high / cells as f64) as $type;
                // One bit pattern for "not a number" (from infinities of both signs), so that files are
                // the same everywhere.
                if mean.is_nan() { $type::NAN } else { mean }
            }
            #[inline]
            fn order(self, other: $type) -> Ordering {
                self.total_cmp(&other)
            }
            #[inline]
            fn is_nan(self) -> bool {
                $type::is_nan(self)
            }
        }
    };
}

// (The square of an f32 is an f64.)
float_sample!(f32, F32, F32, u32, |x| DoubleDouble::from(x * x));
float_sample!(f64, F64, F64, u64, |x| DoubleDouble::product(x, x));

/// A value whose type is known at compile time: one to four samples of one type. Only kernels know such
/// types; they are chosen once per block or file by [`with_native_type`](super::with_native_type).
pub trait Native: Copy + Debug + Default + Send + Sync + 'static {
    /// Type of each sample.
    type Sample: Arithmetic;
    /// Number of samples.
    const CHANNELS: usize;
    /// Form on disk.
    type Wire: FromBytes + IntoBytes + Unaligned + Immutable + KnownLayout + Copy + Debug + Send + Sync;
    /// Sums of at most 2^15 cells, one per channel.
    type NarrowSums: Copy + Debug + Default + Send + Sync;
    /// Sums of squares of at most 2^15 cells, one per channel.
    type NarrowSquares: Copy + Debug + Default + Send + Sync;
    /// Sums of a block, one per channel.
    type BlockSums: Copy + Debug + Default + Send + Sync;
    /// Sums of squares of a block, one per channel.
    type BlockSquares: Copy + Debug + Default + Send + Sync;
    /// Sums of any number of cells, one per channel.
    type TotalSums: Copy + Debug + Default + Send + Sync;

    /// The type as a run-time value.
    const TYPE: ValueType = ValueType::new(Self::Sample::TYPE, Self::CHANNELS as u8);

    /// From disk.
    fn from_wire(wire: Self::Wire) -> Self;
    /// To disk.
    fn to_wire(self) -> Self::Wire;
    /// Sums of one cell of this value.
    fn narrow_sums(self) -> Self::NarrowSums;
    /// Adds channel by channel.
    fn add_narrow_sums(a: Self::NarrowSums, b: Self::NarrowSums) -> Self::NarrowSums;
    /// Squares of the samples of one cell.
    fn narrow_squares(self) -> Self::NarrowSquares;
    /// Adds channel by channel.
    fn add_narrow_squares(a: Self::NarrowSquares, b: Self::NarrowSquares) -> Self::NarrowSquares;
    /// Sums of squares of a few cells as those of a block.
    fn widen_narrow_squares(squares: Self::NarrowSquares) -> Self::BlockSquares;
    /// Means of 2^`bits` cells (at most 2^15), rounded to the type.
    fn narrow_mean(sums: Self::NarrowSums, bits: u32) -> Self;
    /// The sums of a few cells as sums of a block.
    fn widen_narrow(sums: Self::NarrowSums) -> Self::BlockSums;
    /// Sums of `cells` cells of this value (at most 2^24).
    fn block_sums(self, cells: u32) -> Self::BlockSums;
    /// Adds channel by channel.
    fn add_block_sums(a: Self::BlockSums, b: Self::BlockSums) -> Self::BlockSums;
    /// Sums of the squares of `cells` cells of this value (at most 2^24).
    fn block_squares(self, cells: u32) -> Self::BlockSquares;
    /// Adds channel by channel.
    fn add_block_squares(a: Self::BlockSquares, b: Self::BlockSquares) -> Self::BlockSquares;
    /// The sums of a block as sums of any number of cells.
    fn widen(sums: Self::BlockSums) -> Self::TotalSums;
    /// Sums of squares of a block as sums of any number of cells.
    fn widen_squares(squares: Self::BlockSquares) -> Self::TotalSums;
    /// Means of at most 2^24 cells, rounded to the type.
    fn block_mean(sums: Self::BlockSums, cells: u32) -> Self;
    /// Sums of any number of cells of this value.
    fn total_sums(self, cells: u64) -> Self::TotalSums;
    /// Sums of the squares of any number of cells of this value.
    fn total_squares(self, cells: u64) -> Self::TotalSums;
    /// Adds channel by channel.
    fn add_sums(a: Self::TotalSums, b: Self::TotalSums) -> Self::TotalSums;
    /// The sums with their type known at run time.
    fn erase(sums: Self::TotalSums) -> Sums;
    /// The inverse of [`Native::erase`].
    fn typed_sums(sums: &Sums) -> Self::TotalSums;
    /// Means of any number of cells, rounded to the type.
    fn mean(sums: &Sums, cells: u64) -> Self;
    /// A total order: channel after channel.
    fn order(self, other: Self) -> Ordering;
    /// The smaller sample of each channel.
    fn min(self, other: Self) -> Self;
    /// The larger sample of each channel.
    fn max(self, other: Self) -> Self;
    /// Whether both are equal in every bit.
    fn same(self, other: Self) -> bool;
    /// Joins channel by channel, in f64, and keeps the results within what the type can hold.
    fn by_channel(self, other: Self, join: fn(f64, f64) -> f64) -> Self;
    /// Whether any sample is not a number; such a value is VOID.
    fn is_nan(self) -> bool;
}

macro_rules! native_values {
    ($($channels:literal)*) => { $(
        impl<S: Arithmetic> Native for [S; $channels] {
            type Sample = S;
            const CHANNELS: usize = $channels;
            type Wire = [S::Wire; $channels];
            type NarrowSums = [S::NarrowSum; $channels];
            type NarrowSquares = [S::NarrowSquare; $channels];
            type BlockSums = [S::BlockSum; $channels];
            type BlockSquares = [S::BlockSquare; $channels];
            type TotalSums = [S::TotalSum; $channels];

            #[inline]
            fn from_wire(wire: Self::Wire) -> Self {
                wire.map(S::from_wire)
            }
            #[inline]
            fn to_wire(self) -> Self::Wire {
                self.map(S::to_wire)
            }
            #[inline]
            fn narrow_sums(self) -> Self::NarrowSums {
                self.map(S::narrow_sum)
            }
            #[inline]
            fn add_narrow_sums(a: Self::NarrowSums, b: Self::NarrowSums) -> Self::NarrowSums {
                std::array::from_fn(|c| a[c] + b[c])
            }
            #[inline]
            fn narrow_squares(self) -> Self::NarrowSquares {
                self.map(S::narrow_square)
            }
            #[inline]
            fn add_narrow_squares(a: Self::NarrowSquares, b: Self::NarrowSquares) -> Self::NarrowSquares {
                std::array::from_fn(|c| a[c] + b[c])
            }
            #[inline]
            fn widen_narrow_squares(squares: Self::NarrowSquares) -> Self::BlockSquares {
                squares.map(Into::into)
            }
            #[inline]
            fn narrow_mean(sums: Self::NarrowSums, bits: u32) -> Self {
                sums.map(|sum| S::narrow_mean(sum, bits))
            }
            #[inline]
            fn widen_narrow(sums: Self::NarrowSums) -> Self::BlockSums {
                sums.map(Into::into)
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
            #[inline]
            fn widen(sums: Self::BlockSums) -> Self::TotalSums {
                sums.map(Into::into)
            }
            #[inline]
            fn widen_squares(squares: Self::BlockSquares) -> Self::TotalSums {
                squares.map(Into::into)
            }
            #[inline]
            fn block_mean(sums: Self::BlockSums, cells: u32) -> Self {
                sums.map(|sum| S::block_mean(sum, cells))
            }
            #[inline]
            fn total_sums(self, cells: u64) -> Self::TotalSums {
                self.map(|sample| sample.total_sum(cells))
            }
            #[inline]
            fn total_squares(self, cells: u64) -> Self::TotalSums {
                self.map(|sample| sample.total_square(cells))
            }
            #[inline]
            fn add_sums(a: Self::TotalSums, b: Self::TotalSums) -> Self::TotalSums {
                std::array::from_fn(|c| a[c] + b[c])
            }
            fn erase(sums: Self::TotalSums) -> Sums {
                S::TotalSum::to_sums(&sums)
            }
            fn typed_sums(sums: &Sums) -> Self::TotalSums {
                let sums = S::TotalSum::from_sums(sums);
                std::array::from_fn(|channel| sums[channel])
            }
            fn mean(sums: &Sums, cells: u64) -> Self {
                let sums = S::TotalSum::from_sums(sums);
                std::array::from_fn(|channel| S::mean(sums[channel], cells))
            }
            #[inline]
            fn order(self, other: Self) -> Ordering {
                (0..$channels).map(|c| self[c].order(other[c])).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
            }
            #[inline]
            fn min(self, other: Self) -> Self {
                std::array::from_fn(|c| if other[c].order(self[c]).is_lt() { other[c] } else { self[c] })
            }
            #[inline]
            fn max(self, other: Self) -> Self {
                std::array::from_fn(|c| if other[c].order(self[c]).is_gt() { other[c] } else { self[c] })
            }
            #[inline]
            fn same(self, other: Self) -> bool {
                self.to_wire().as_bytes() == other.to_wire().as_bytes()
            }
            #[inline]
            fn by_channel(self, other: Self, join: fn(f64, f64) -> f64) -> Self {
                std::array::from_fn(|c| S::from_f64_lossy(join(self[c].to_f64(), other[c].to_f64())))
            }
            #[inline]
            fn is_nan(self) -> bool {
                self.iter().any(|sample| sample.is_nan())
            }
        }
    )* };
}

native_values!(1 2 3 4);

#[cfg(test)]
mod tests {
    use super::*;

    /// Sum and mean of the largest block that a header allows, all cells alike.
    fn mean_of_largest<S: Arithmetic>(sample: S) -> S {
        let half = 1 << 23;
        let _ = sample.block_square(half) + sample.block_square(half);
        S::block_mean(sample.block_sum(half) + sample.block_sum(half), 2 * half)
    }

    #[test]
    fn sums_of_the_largest_blocks_fit() {
        assert_eq!(mean_of_largest(u8::MAX), u8::MAX);
        assert_eq!(mean_of_largest(u16::MAX), u16::MAX);
        assert_eq!(mean_of_largest(i16::MIN), i16::MIN);
        assert_eq!(mean_of_largest(u32::MAX), u32::MAX);
        assert_eq!(mean_of_largest(i32::MIN), i32::MIN);
    }
}

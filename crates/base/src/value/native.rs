//! Values whose type is known at compile time: one to four samples of one type.

use std::cmp::Ordering;
use std::fmt::Debug;

use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::sample::{Arithmetic, Sample, TotalSum};
use super::sums::Sums;
use super::value_type::ValueType;
use crate::array;

/// A value whose type is known at compile time: one to four samples of one type.
///
/// Only kernels know such types. [`with_native_type`](super::with_native_type) selects them once
/// per block or file.
pub trait Native: Copy + Debug + Default + Send + Sync + 'static {
    /// Type of each sample.
    type Sample: Arithmetic;
    /// Number of samples.
    const CHANNELS: usize;
    /// Representation on disk.
    type Wire: FromBytes + IntoBytes + Unaligned + Immutable + KnownLayout + Copy + Debug + Send + Sync;
    /// Sums of at most 2^15 cells, one per channel.
    type NarrowSums: Copy + Debug + Default + Send + Sync;
    /// Sums of squares of at most 2^15 cells, one per channel.
    type NarrowSquares: Copy + Debug + Default + Send + Sync;
    /// Sums of a block (at most 2^24 cells), one per channel.
    type BlockSums: Copy + Debug + Default + Send + Sync;
    /// Sums of squares of a block, one per channel.
    type BlockSquares: Copy + Debug + Default + Send + Sync;
    /// Sums of any number of cells, one per channel.
    type TotalSums: Copy + Debug + Default + Send + Sync;
    /// Sums of squares of any number of cells, one per channel.
    type TotalSquares: Copy + Debug + Default + Send + Sync;

    /// The type as a run-time value.
    const TYPE: ValueType = ValueType::new(Self::Sample::TYPE, Self::CHANNELS as u8);

    /// Converts from the representation on disk.
    fn from_wire(wire: Self::Wire) -> Self;
    /// Converts to the representation on disk.
    fn to_wire(self) -> Self::Wire;
    /// Returns the sums of one cell with this value.
    fn narrow_sums(self) -> Self::NarrowSums;
    /// Adds channel by channel.
    fn add_narrow_sums(a: Self::NarrowSums, b: Self::NarrowSums) -> Self::NarrowSums;
    /// Returns the squares of one cell's samples.
    fn narrow_squares(self) -> Self::NarrowSquares;
    /// Adds channel by channel.
    fn add_narrow_squares(a: Self::NarrowSquares, b: Self::NarrowSquares) -> Self::NarrowSquares;
    /// Converts sums of squares of few cells to those of a block.
    fn widen_narrow_squares(squares: Self::NarrowSquares) -> Self::BlockSquares;
    /// Returns the means of 2^`bits` cells (at most 2^15), rounded to the type.
    fn narrow_mean(sums: Self::NarrowSums, bits: u32) -> Self;
    /// Converts sums of few cells to those of a block.
    fn widen_narrow(sums: Self::NarrowSums) -> Self::BlockSums;
    /// Returns the sums of `cells` cells with this value (at most 2^24).
    fn block_sums(self, cells: u32) -> Self::BlockSums;
    /// Adds channel by channel.
    fn add_block_sums(a: Self::BlockSums, b: Self::BlockSums) -> Self::BlockSums;
    /// Returns the sums of squares of `cells` cells with this value (at most 2^24).
    fn block_squares(self, cells: u32) -> Self::BlockSquares;
    /// Adds channel by channel.
    fn add_block_squares(a: Self::BlockSquares, b: Self::BlockSquares) -> Self::BlockSquares;
    /// Converts sums of a block to those of any number of cells.
    fn widen(sums: Self::BlockSums) -> Self::TotalSums;
    /// Converts sums of squares of a block to those of any number of cells.
    fn widen_squares(squares: Self::BlockSquares) -> Self::TotalSquares;
    /// Returns the means of at most 2^24 cells, rounded to the type.
    fn block_mean(sums: Self::BlockSums, cells: u32) -> Self;
    /// Returns the sums of any number of cells with this value.
    fn total_sums(self, cells: u64) -> Self::TotalSums;
    /// Returns the sums of squares of any number of cells with this value.
    fn total_squares(self, cells: u64) -> Self::TotalSquares;
    /// Adds channel by channel.
    fn add_sums(a: Self::TotalSums, b: Self::TotalSums) -> Self::TotalSums;
    /// Adds channel by channel.
    fn add_squares(a: Self::TotalSquares, b: Self::TotalSquares) -> Self::TotalSquares;
    /// Converts sums to the run-time type.
    fn erase(sums: Self::TotalSums) -> Sums;
    /// Converts sums of squares to the run-time type.
    fn erase_squares(squares: Self::TotalSquares) -> Sums;
    /// Inverse of [`Native::erase`].
    fn typed_sums(sums: &Sums) -> Self::TotalSums;
    /// Inverse of [`Native::erase_squares`].
    fn typed_squares(squares: &Sums) -> Self::TotalSquares;
    /// Returns the means of any number of cells, rounded to the type.
    fn mean(sums: &Sums, cells: u64) -> Self;
    /// Compares in a total order: channel by channel.
    fn order(self, other: Self) -> Ordering;
    /// Returns the smaller sample of each channel.
    fn min(self, other: Self) -> Self;
    /// Returns the larger sample of each channel.
    fn max(self, other: Self) -> Self;
    /// Whether both values are equal in every bit.
    fn same(self, other: Self) -> bool;
    /// Adds channel by channel; saturates at the limits of integer types.
    fn plus(self, other: Self) -> Self;
    /// Subtracts channel by channel; saturates at the limits of integer types.
    fn minus(self, other: Self) -> Self;
    /// Whether any sample is NaN. Such a value is VOID.
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
            type TotalSquares = [S::TotalSquare; $channels];

            #[inline]
            fn from_wire(wire: Self::Wire) -> Self {
                array::map(wire, S::from_wire)
            }
            #[inline]
            fn to_wire(self) -> Self::Wire {
                array::map(self, S::to_wire)
            }
            #[inline]
            fn narrow_sums(self) -> Self::NarrowSums {
                array::map(self, S::narrow_sum)
            }
            #[inline]
            fn add_narrow_sums(a: Self::NarrowSums, b: Self::NarrowSums) -> Self::NarrowSums {
                array::from_fn(|c| a[c] + b[c])
            }
            #[inline]
            fn narrow_squares(self) -> Self::NarrowSquares {
                array::map(self, S::narrow_square)
            }
            #[inline]
            fn add_narrow_squares(a: Self::NarrowSquares, b: Self::NarrowSquares) -> Self::NarrowSquares {
                array::from_fn(|c| a[c] + b[c])
            }
            #[inline]
            fn widen_narrow_squares(squares: Self::NarrowSquares) -> Self::BlockSquares {
                array::map(squares, Into::into)
            }
            #[inline]
            fn narrow_mean(sums: Self::NarrowSums, bits: u32) -> Self {
                array::map(sums, |sum| S::narrow_mean(sum, bits))
            }
            #[inline]
            fn widen_narrow(sums: Self::NarrowSums) -> Self::BlockSums {
                array::map(sums, Into::into)
            }
            #[inline]
            fn block_sums(self, cells: u32) -> Self::BlockSums {
                array::map(self, |sample| sample.block_sum(cells))
            }
            #[inline]
            fn add_block_sums(a: Self::BlockSums, b: Self::BlockSums) -> Self::BlockSums {
                array::from_fn(|c| a[c] + b[c])
            }
            #[inline]
            fn block_squares(self, cells: u32) -> Self::BlockSquares {
                array::map(self, |sample| sample.block_square(cells))
            }
            #[inline]
            fn add_block_squares(a: Self::BlockSquares, b: Self::BlockSquares) -> Self::BlockSquares {
                array::from_fn(|c| a[c] + b[c])
            }
            #[inline]
            fn widen(sums: Self::BlockSums) -> Self::TotalSums {
                array::map(sums, Into::into)
            }
            #[inline]
            fn widen_squares(squares: Self::BlockSquares) -> Self::TotalSquares {
                array::map(squares, Into::into)
            }
            #[inline]
            fn block_mean(sums: Self::BlockSums, cells: u32) -> Self {
                array::map(sums, |sum| S::block_mean(sum, cells))
            }
            #[inline]
            fn total_sums(self, cells: u64) -> Self::TotalSums {
                array::map(self, |sample| sample.total_sum(cells))
            }
            #[inline]
            fn total_squares(self, cells: u64) -> Self::TotalSquares {
                array::map(self, |sample| sample.total_square(cells))
            }
            #[inline]
            fn add_sums(a: Self::TotalSums, b: Self::TotalSums) -> Self::TotalSums {
                array::from_fn(|c| a[c] + b[c])
            }
            #[inline]
            fn add_squares(a: Self::TotalSquares, b: Self::TotalSquares) -> Self::TotalSquares {
                array::from_fn(|c| a[c] + b[c])
            }
            fn erase(sums: Self::TotalSums) -> Sums {
                S::TotalSum::to_sums(&sums)
            }
            fn erase_squares(squares: Self::TotalSquares) -> Sums {
                S::TotalSquare::to_sums(&squares)
            }
            fn typed_sums(sums: &Sums) -> Self::TotalSums {
                let sums = S::TotalSum::from_sums(sums);
                array::from_fn(|channel| sums[channel])
            }
            fn typed_squares(squares: &Sums) -> Self::TotalSquares {
                let squares = S::TotalSquare::from_sums(squares);
                array::from_fn(|channel| squares[channel])
            }
            fn mean(sums: &Sums, cells: u64) -> Self {
                let sums = S::TotalSum::from_sums(sums);
                array::from_fn(|channel| S::mean(sums[channel], cells))
            }
            #[inline]
            fn order(self, other: Self) -> Ordering {
                let mut order = Ordering::Equal;
                let mut c = 0;
                while c < $channels && order.is_eq() {
                    order = self[c].order(other[c]);
                    c += 1;
                }
                order
            }
            #[inline]
            fn min(self, other: Self) -> Self {
                array::from_fn(|c| if other[c].order(self[c]).is_lt() { other[c] } else { self[c] })
            }
            #[inline]
            fn max(self, other: Self) -> Self {
                array::from_fn(|c| if other[c].order(self[c]).is_gt() { other[c] } else { self[c] })
            }
            #[inline]
            fn same(self, other: Self) -> bool {
                self.to_wire().as_bytes() == other.to_wire().as_bytes()
            }
            #[inline]
            fn plus(self, other: Self) -> Self {
                array::from_fn(|c| self[c].plus(other[c]))
            }
            #[inline]
            fn minus(self, other: Self) -> Self {
                array::from_fn(|c| self[c].minus(other[c]))
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

    /// Computes sum and mean of the largest block that a header allows, with equal samples.
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
        assert_eq!(mean_of_largest(i8::MIN), i8::MIN);
        assert_eq!(mean_of_largest(u64::MAX), u64::MAX);
        assert_eq!(mean_of_largest(i64::MIN), i64::MIN);
    }
}

//! Samples whose type is known at compile time, for kernels.

use std::cmp::Ordering;
use std::fmt::Debug;
use std::ops::Add;

use zerocopy::little_endian::{F32, F64, I16, I32, I64, U16, U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::double::DoubleDouble;
use super::number::Number;
use super::square_sum::SquareSum;
use super::sums::Sums;
use super::triple::TripleDouble;
use super::value_type::SampleType;

/// Sums of any number of samples, or of their squares: see [`Sums`].
pub trait TotalSum: Copy + Debug + Default + Add<Output = Self> + Send + Sync + 'static {
    /// Converts one sum per channel, at most four.
    fn to_sums(sums: &[Self]) -> Sums;
    /// Inverse of [`TotalSum::to_sums`]; returns zeros for sums of another variant.
    fn from_sums(sums: &Sums) -> [Self; 4];
}

macro_rules! total_sum {
    ($type:ident, $variant:ident) => {
        impl TotalSum for $type {
            fn to_sums(sums: &[$type]) -> Sums {
                Sums::$variant(std::array::from_fn(|channel| sums.get(channel).copied().unwrap_or_default()))
            }

            fn from_sums(sums: &Sums) -> [$type; 4] {
                if let Sums::$variant(sums) = sums { *sums } else { Default::default() }
            }
        }
    };
}

total_sum!(i128, Exact);
total_sum!(SquareSum, Squares);
total_sum!(DoubleDouble, Double);
total_sum!(TripleDouble, Triple);

/// One number of a value.
pub trait Sample: Copy + Debug + Default + PartialEq + PartialOrd + Send + Sync + 'static {
    /// The type as a run-time value.
    const TYPE: SampleType;

    /// Reads a sample from the start of a slice, little-endian.
    fn read(bytes: &[u8]) -> Self;
    /// Writes the sample's bytes, little-endian.
    fn write(self, bytes: &mut [u8]);
    /// Returns the number as an f64: the nearest one for 64-bit integers, exact for other types.
    fn to_f64(self) -> f64;
    /// Returns the sample nearest to a number.
    fn from_f64_lossy(number: f64) -> Self;
    /// Returns the number, exactly.
    fn to_number(self) -> Number;
    /// Returns the sample equal to a number; `None` if there is none.
    fn from_number(number: Number) -> Option<Self>;
    /// Returns the sample nearest to an exact number.
    fn from_number_lossy(number: Number) -> Self;
    /// Returns a key that orders samples: by number, then (for floats) by bits as in
    /// `f64::total_cmp`.
    fn order_key(self) -> u64;
    /// Inverse of [`Sample::order_key`].
    fn from_order_key(key: u64) -> Self;
    /// Returns the sample for computation: of a 64-bit integer the difference from `base`, which
    /// loses fewer digits in an f64.
    fn relative_to(self, base: Self) -> f64;
    /// Returns the sample nearest to a result that was computed with [`Sample::relative_to`].
    /// Integers are rounded half up.
    fn from_relative(base: Self, number: f64) -> Self;
}

/// Representation on disk, sums and means of samples, for kernels.
pub trait Arithmetic: Sample {
    /// Representation on disk: little-endian, unaligned.
    type Wire: FromBytes
        + IntoBytes
        + Unaligned
        + Immutable
        + KnownLayout
        + Copy
        + Debug
        + Default
        + Send
        + Sync;
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
        + Into<Self::TotalSquare>
        + Send
        + Sync;
    /// Sum over any number of cells.
    type TotalSum: TotalSum;
    /// Sum of squares over any number of cells.
    type TotalSquare: TotalSum;

    /// Converts from the representation on disk.
    fn from_wire(wire: Self::Wire) -> Self;
    /// Converts to the representation on disk.
    fn to_wire(self) -> Self::Wire;
    /// Returns the sum of one sample.
    fn narrow_sum(self) -> Self::NarrowSum;
    /// Returns the square of one sample.
    fn narrow_square(self) -> Self::NarrowSquare;
    /// Returns the mean of 2^`bits` samples (at most 2^15), rounded to the type.
    fn narrow_mean(sum: Self::NarrowSum, bits: u32) -> Self;
    /// Returns the sum of `cells` equal samples (at most 2^24).
    fn block_sum(self, cells: u32) -> Self::BlockSum;
    /// Returns the sum of the squares of `cells` equal samples (at most 2^24).
    fn block_square(self, cells: u32) -> Self::BlockSquare;
    /// Returns the sum of any number of equal samples.
    fn total_sum(self, cells: u64) -> Self::TotalSum;
    /// Returns the sum of the squares of any number of equal samples.
    fn total_square(self, cells: u64) -> Self::TotalSquare;
    /// Returns the mean of at most 2^24 samples, rounded to the type.
    fn block_mean(sum: Self::BlockSum, cells: u32) -> Self;
    /// Returns the mean of any number of samples, rounded to the type.
    fn mean(sum: Self::TotalSum, cells: u64) -> Self;
    /// Returns the sum; saturates at the limits of integer types.
    fn plus(self, other: Self) -> Self;
    /// Returns the difference; saturates at the limits of integer types.
    fn minus(self, other: Self) -> Self;
    /// Compares in a total order: by number, then (for floats) by bits as in `f64::total_cmp`.
    fn order(self, other: Self) -> Ordering;
    /// Whether the sample is NaN.
    fn is_nan(self) -> bool;
}

macro_rules! integer_sample {
    ($type:ident, $variant:ident, $flip:literal, $relative:expr, $absolute:expr) => {
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
            fn from_f64_lossy(number: f64) -> $type {
                number as $type
            }
            #[inline]
            fn to_number(self) -> Number {
                self.into()
            }
            #[inline]
            fn from_number(number: Number) -> Option<$type> {
                number.with_plain_zero().to_integer().and_then(|number| number.try_into().ok())
            }
            #[inline]
            fn from_number_lossy(number: Number) -> $type {
                match number {
                    Number::Unsigned(number) => number.try_into().unwrap_or($type::MAX),
                    Number::Signed(number) => {
                        number.try_into().unwrap_or(if number < 0 { $type::MIN } else { $type::MAX })
                    }
                    Number::Float(number) => number as $type,
                }
            }
            #[inline]
            fn order_key(self) -> u64 {
                // Flips the sign bit: the lowest number of a signed type becomes 0.
                let bits = 8 * size_of::<$type>() as u32;
                (self as i64 as u64).wrapping_add($flip << (bits - 1)) & (u64::MAX >> (64 - bits))
            }
            #[inline]
            fn from_order_key(key: u64) -> $type {
                let bits = 8 * size_of::<$type>() as u32;
                key.wrapping_sub($flip << (bits - 1)) as $type
            }
            #[inline]
            fn relative_to(self, base: $type) -> f64 {
                $relative(self, base)
            }
            #[inline]
            fn from_relative(base: $type, number: f64) -> $type {
                $absolute(base, (number + 0.5).floor())
            }
        }
    };
}

/// Returns the difference of two 64-bit integers.
fn difference(number: impl Into<i128>, base: impl Into<i128>) -> f64 {
    (number.into() - base.into()) as f64
}

integer_sample!(u8, U8, 0u64, |number, _| f64::from(number), |_, number| number as u8);
integer_sample!(u16, U16, 0u64, |number, _| f64::from(number), |_, number| number as u16);
integer_sample!(i16, I16, 1u64, |number, _| f64::from(number), |_, number| number as i16);
integer_sample!(u32, U32, 0u64, |number, _| f64::from(number), |_, number| number as u32);
integer_sample!(i32, I32, 1u64, |number, _| f64::from(number), |_, number| number as i32);
integer_sample!(i8, I8, 1u64, |number, _| f64::from(number), |_, number| number as i8);
integer_sample!(u64, U64, 0u64, difference, |base, number: f64| {
    i128::from(base).saturating_add(number as i128).clamp(0, u64::MAX.into()) as u64
});
integer_sample!(i64, I64, 1u64, difference, |base, number: f64| {
    i128::from(base).saturating_add(number as i128).clamp(i64::MIN.into(), i64::MAX.into()) as i64
});

/// Arithmetic that integers of all widths share.
macro_rules! integer_arithmetic {
    ($type:ident, $to:expr, $from:expr) => {
        #[inline]
        fn from_wire(wire: Self::Wire) -> $type {
            $from(wire)
        }
        #[inline]
        fn to_wire(self) -> Self::Wire {
            $to(self)
        }
        #[inline]
        fn narrow_sum(self) -> Self::NarrowSum {
            self as Self::NarrowSum
        }
        #[inline]
        fn narrow_mean(sum: Self::NarrowSum, bits: u32) -> $type {
            // Rounded half up: see `block_mean`.
            ((sum + (1 << bits >> 1)) >> bits) as $type
        }
        #[inline]
        fn block_sum(self, cells: u32) -> Self::BlockSum {
            self as Self::BlockSum * cells as Self::BlockSum
        }
        #[inline]
        fn total_sum(self, cells: u64) -> i128 {
            (self as i128).wrapping_mul(cells as i128)
        }
        fn mean(sum: i128, cells: u64) -> $type {
            let cells = cells as i128;
            (2 * sum + cells).div_euclid(2 * cells) as $type
        }
        #[inline]
        fn plus(self, other: $type) -> $type {
            self.saturating_add(other)
        }
        #[inline]
        fn minus(self, other: $type) -> $type {
            self.saturating_sub(other)
        }
        #[inline]
        fn order(self, other: $type) -> Ordering {
            self.cmp(&other)
        }
        #[inline]
        fn is_nan(self) -> bool {
            false
        }
    };
}

/// Integers of at most 32 bits, whose squares are summed in primitive integers.
macro_rules! narrow_integer {
    ($type:ident, $wire:ty, $narrow:ty, $narrow_square:ty, $sum:ty, $square:ty, $to:expr, $from:expr) => {
        impl Arithmetic for $type {
            type Wire = $wire;
            type NarrowSum = $narrow;
            type NarrowSquare = $narrow_square;
            type BlockSum = $sum;
            type BlockSquare = $square;
            type TotalSum = i128;
            type TotalSquare = i128;

            integer_arithmetic!($type, $to, $from);

            #[inline]
            fn narrow_square(self) -> $narrow_square {
                self as $narrow_square * self as $narrow_square
            }
            #[inline]
            fn block_square(self, cells: u32) -> $square {
                self as $square * self as $square * cells as $square
            }
            #[inline]
            fn total_square(self, cells: u64) -> i128 {
                let wide = self as i64 as i128;
                (wide * wide).wrapping_mul(cells as i128)
            }
            #[inline]
            fn block_mean(sum: $sum, cells: u32) -> $type {
                // Rounded half up: floor((2 sum + cells) / (2 cells)). A shift rounds down for
                // negative numbers, too. It cannot overflow: the sum of 2^24 samples of 32 bits has
                // 56 bits.
                let (twice, half_up) = (2 * i64::from(cells), 2 * i64::from(sum) + i64::from(cells));
                if cells.is_power_of_two() {
                    (half_up >> twice.trailing_zeros()) as $type
                } else {
                    half_up.div_euclid(twice) as $type
                }
            }
        }
    };
}

narrow_integer!(u8, u8, u32, u32, u32, i64, |x| x, |x| x);
narrow_integer!(u16, U16, u32, i64, i64, i64, U16::new, |x: U16| x.get());
narrow_integer!(i16, I16, i32, i64, i64, i64, I16::new, |x: I16| x.get());
narrow_integer!(u32, U32, i64, i128, i64, i128, U32::new, |x: U32| x.get());
narrow_integer!(i32, I32, i64, i128, i64, i128, I32::new, |x: I32| x.get());
narrow_integer!(i8, i8, i32, i32, i32, i64, |x| x, |x| x);

/// Integers of 64 bits, whose squares have 128.
macro_rules! wide_integer {
    ($type:ident, $wire:ty, $to:expr, $from:expr) => {
        impl Arithmetic for $type {
            type Wire = $wire;
            type NarrowSum = i128;
            type NarrowSquare = SquareSum;
            type BlockSum = i128;
            type BlockSquare = SquareSum;
            type TotalSum = i128;
            type TotalSquare = SquareSum;

            integer_arithmetic!($type, $to, $from);

            #[inline]
            fn narrow_square(self) -> SquareSum {
                self.total_square(1)
            }
            #[inline]
            fn block_square(self, cells: u32) -> SquareSum {
                self.total_square(cells.into())
            }
            #[inline]
            fn total_square(self, cells: u64) -> SquareSum {
                SquareSum::of(self.into()).times(cells)
            }
            #[inline]
            fn block_mean(sum: i128, cells: u32) -> $type {
                Self::mean(sum, cells.into())
            }
        }
    };
}

wide_integer!(u64, U64, U64::new, |x: U64| x.get());
wide_integer!(i64, I64, I64::new, |x: I64| x.get());

macro_rules! float_sample {
    ($type:ident, $variant:ident, $wire:ty, $bits:ident, $square_sum:ty, $square:expr) => {
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
            fn from_f64_lossy(number: f64) -> $type {
                number as $type
            }
            #[inline]
            fn to_number(self) -> Number {
                self.into()
            }
            #[inline]
            fn from_number(number: Number) -> Option<$type> {
                let near = $type::from_number_lossy(number);
                (Number::from(near).with_plain_zero() == number.with_plain_zero() && !near.is_nan())
                    .then_some(near)
            }
            #[inline]
            fn from_number_lossy(number: Number) -> $type {
                match number {
                    Number::Unsigned(number) => number as $type,
                    Number::Signed(number) => number as $type,
                    Number::Float(number) => number as $type,
                }
            }
            #[inline]
            fn order_key(self) -> u64 {
                // Negative numbers have all bits inverted, which puts them below the others in
                // reverse order.
                let bits = self.to_bits();
                let sign = 1 << ($bits::BITS - 1);
                u64::from(if bits & sign == 0 { bits | sign } else { !bits })
            }
            #[inline]
            fn from_order_key(key: u64) -> $type {
                let (key, sign) = (key as $bits, 1 << ($bits::BITS - 1));
                $type::from_bits(if key & sign == 0 { !key } else { key & !sign })
            }
            #[inline]
            fn relative_to(self, _: $type) -> f64 {
                self.into()
            }
            #[inline]
            fn from_relative(_: $type, number: f64) -> $type {
                number as $type
            }
        }

        impl Arithmetic for $type {
            type Wire = $wire;
            type NarrowSum = DoubleDouble;
            type NarrowSquare = $square_sum;
            type BlockSum = DoubleDouble;
            type BlockSquare = $square_sum;
            type TotalSum = DoubleDouble;
            type TotalSquare = $square_sum;

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
            fn narrow_square(self) -> $square_sum {
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
            fn block_square(self, cells: u32) -> $square_sum {
                self.total_square(cells.into())
            }
            #[inline]
            fn total_sum(self, cells: u64) -> DoubleDouble {
                DoubleDouble::from(f64::from(self)).times(cells)
            }
            #[inline]
            fn total_square(self, cells: u64) -> $square_sum {
                let square: fn(f64) -> $square_sum = $square;
                square(f64::from(self)).times(cells)
            }
            #[inline]
            fn block_mean(sum: DoubleDouble, cells: u32) -> $type {
                Self::mean(sum, cells as u64)
            }
            #[inline]
            fn mean(sum: DoubleDouble, cells: u64) -> $type {
                let mean = (sum.high / cells as f64) as $type;
                // One bit pattern for NaN (from infinities of both signs), so that files are the
                // same on all platforms.
                if mean.is_nan() { $type::NAN } else { mean }
            }
            #[inline]
            fn plus(self, other: $type) -> $type {
                (f64::from(self) + f64::from(other)) as $type
            }
            #[inline]
            fn minus(self, other: $type) -> $type {
                (f64::from(self) - f64::from(other)) as $type
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

// The square of an f32 is exact in an f64.
float_sample!(f32, F32, F32, u32, DoubleDouble, |x| DoubleDouble::from(x * x));
float_sample!(f64, F64, F64, u64, TripleDouble, TripleDouble::square);

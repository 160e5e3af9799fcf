//! Values with a type that is known at run time, and operations on single values.
//!
//! Code above the kernels handles values as bytes: two values are the same if all bytes are. Code
//! that needs numbers calls methods of [`ValueType`], which dispatch for each sample. Work on many
//! values belongs into kernels, which know the type at compile time.

use std::cmp::Ordering;
use std::ops::Deref;

use super::number::Number;
use super::sample::Sample;
use super::value_type::{SampleType, ValueType};

/// A value as its bytes on disk, little-endian, padded with zeros.
///
/// ```
/// use spinney::{SampleType, Value, ValueType};
/// let rgb = ValueType::new(SampleType::U8, 3);
/// let orange = Value::from([255u8, 165, 0]);
/// assert_eq!(rgb.samples(orange)[..], [255.0, 165.0, 0.0]);
/// assert_eq!(rgb.exact(&[255, 165, 0].map(Into::into)), Some(orange));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Value {
    words: [u64; 2],
}

/// Size of the largest values in bytes.
pub const MAX_VALUE_SIZE: usize = size_of::<Value>();

impl Value {
    /// The value with all bytes zero.
    pub const ZERO: Value = Value { words: [0; 2] };

    /// Returns the value with these bytes, at most 16.
    ///
    /// # Panics
    /// If there are more.
    #[inline]
    pub fn from_bytes(bytes: &[u8]) -> Value {
        let mut all = [0; MAX_VALUE_SIZE];
        all[..bytes.len()].copy_from_slice(bytes);
        Value::from_wide(u128::from_le_bytes(all))
    }

    /// Reads a value of `width` bytes from the start of a slice; `None` if the slice is too short.
    #[inline]
    pub fn read(bytes: &[u8], width: usize) -> Option<Value> {
        match bytes.first_chunk::<MAX_VALUE_SIZE>() {
            // One load and a mask, if the slice has enough bytes after the value.
            Some(wide) => Some(Value::from_wide(u128::from_le_bytes(*wide) & mask(width))),
            None => bytes.get(..width).map(Value::from_bytes),
        }
    }

    #[inline]
    fn from_wide(wide: u128) -> Value {
        Value { words: [wide as u64, (wide >> 64) as u64] }
    }

    /// Returns the bytes, padded with zeros.
    #[inline]
    pub fn to_bytes(self) -> [u8; MAX_VALUE_SIZE] {
        let mut bytes = [0; MAX_VALUE_SIZE];
        bytes[..8].copy_from_slice(&self.words[0].to_le_bytes());
        bytes[8..].copy_from_slice(&self.words[1].to_le_bytes());
        bytes
    }

    /// Returns the exclusive or of the two words.
    pub(super) fn folded(self) -> u64 {
        self.words[0] ^ self.words[1]
    }

    /// Writes as many of the value's bytes as the slice has.
    #[inline]
    pub fn write(self, bytes: &mut [u8]) {
        let all = self.to_bytes();
        // The usual widths are single stores; a copy of variable length is a call.
        match bytes.len() {
            1 => bytes[0] = all[0],
            2 => bytes.copy_from_slice(&all[..2]),
            4 => bytes.copy_from_slice(&all[..4]),
            8 => bytes.copy_from_slice(&all[..8]),
            length => bytes.copy_from_slice(&all[..length]),
        }
    }
}

/// Returns a mask of the lowest `width` bytes.
#[inline]
fn mask(width: usize) -> u128 {
    u128::MAX >> (128 - 8 * width as u32)
}

impl<S: Sample, const CHANNELS: usize> From<[S; CHANNELS]> for Value {
    /// # Panics
    /// If the samples have more than 16 bytes.
    #[inline]
    fn from(samples: [S; CHANNELS]) -> Value {
        let mut bytes = [0; MAX_VALUE_SIZE];
        for (sample, target) in samples.into_iter().zip(bytes.chunks_exact_mut(size_of::<S>())) {
            sample.write(target);
        }
        Value::from_wide(u128::from_le_bytes(bytes))
    }
}

/// Samples of a value for computation. f64 is exact for all types except 64-bit integers; see
/// [`Numbers`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Samples {
    numbers: [f64; 4],
    channels: u8,
}

impl Deref for Samples {
    type Target = [f64];

    #[inline]
    fn deref(&self) -> &[f64] {
        &self.numbers[..usize::from(self.channels)]
    }
}

impl Samples {
    /// Returns the samples, padded with zeros.
    #[inline]
    pub fn padded(self) -> [f64; 4] {
        self.numbers
    }
}

/// Exact samples of a value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Numbers {
    numbers: [Number; 4],
    channels: u8,
}

impl Deref for Numbers {
    type Target = [Number];

    #[inline]
    fn deref(&self) -> &[Number] {
        &self.numbers[..usize::from(self.channels)]
    }
}

/// Evaluates an expression with the Rust type of a [`SampleType`] bound to a name.
#[doc(hidden)]
#[macro_export]
macro_rules! with_sample_type {
    ($type:expr, $S:ident => $body:expr) => {
        match $type {
            $crate::value::SampleType::U8 => {
                type $S = u8;
                $body
            }
            $crate::value::SampleType::U16 => {
                type $S = u16;
                $body
            }
            $crate::value::SampleType::I16 => {
                type $S = i16;
                $body
            }
            $crate::value::SampleType::U32 => {
                type $S = u32;
                $body
            }
            $crate::value::SampleType::I32 => {
                type $S = i32;
                $body
            }
            $crate::value::SampleType::F32 => {
                type $S = f32;
                $body
            }
            $crate::value::SampleType::F64 => {
                type $S = f64;
                $body
            }
            $crate::value::SampleType::I8 => {
                type $S = i8;
                $body
            }
            $crate::value::SampleType::U64 => {
                type $S = u64;
                $body
            }
            $crate::value::SampleType::I64 => {
                type $S = i64;
                $body
            }
        }
    };
}

pub use with_sample_type;

impl SampleType {
    /// Reads a sample from the start of a slice, as an f64.
    #[inline]
    fn number(self, bytes: &[u8]) -> f64 {
        with_sample_type!(self, S => S::read(bytes).to_f64())
    }

    /// Writes the sample nearest to a number.
    #[inline]
    fn write_nearest(self, number: f64, bytes: &mut [u8]) {
        with_sample_type!(self, S => S::from_f64_lossy(number).write(bytes))
    }

    /// Reads a sample from the start of a slice, exactly.
    #[inline]
    fn exact_number(self, bytes: &[u8]) -> Number {
        with_sample_type!(self, S => S::read(bytes).to_number())
    }

    /// Writes the sample nearest to a number, which may be any 64-bit integer.
    fn write_nearest_number(self, number: Number, bytes: &mut [u8]) {
        with_sample_type!(self, S => S::from_number_lossy(number).write(bytes))
    }

    /// Returns the sample nearest to a number, as a number.
    pub fn nearest(self, number: Number) -> Number {
        with_sample_type!(self, S => S::from_number_lossy(number).to_number())
    }

    /// Whether a sample can be equal to a number.
    pub fn can_hold(self, number: impl Into<Number>) -> bool {
        let number = number.into();
        with_sample_type!(self, S => S::from_number(number).is_some())
    }

    /// Returns a key that orders samples: see [`Sample::order_key`].
    #[inline]
    fn order_key(self, bytes: &[u8]) -> u64 {
        with_sample_type!(self, S => S::read(bytes).order_key())
    }
}

impl ValueType {
    /// Iterates over the bytes of each sample of a value.
    #[inline]
    fn each_sample(self, bytes: &[u8; MAX_VALUE_SIZE]) -> impl Iterator<Item = &[u8]> {
        bytes.chunks_exact(self.sample.size()).take(usize::from(self.channels))
    }

    /// Returns the first sample of a value, exactly.
    #[inline]
    pub fn first_number(self, value: Value) -> Number {
        self.sample.exact_number(&value.to_bytes())
    }

    /// Returns the samples of a value, exactly.
    #[inline]
    pub fn numbers(self, value: Value) -> Numbers {
        let mut numbers = [Number::default(); 4];
        for (number, sample) in numbers.iter_mut().zip(self.each_sample(&value.to_bytes())) {
            *number = self.sample.exact_number(sample);
        }
        Numbers { numbers, channels: self.channels }
    }

    /// Returns the first sample of a value, for computation.
    #[inline]
    pub fn first_sample(self, value: Value) -> f64 {
        self.sample.number(&value.to_bytes())
    }

    /// Returns the samples of a value, for computation.
    #[inline]
    pub fn samples(self, value: Value) -> Samples {
        let mut numbers = [0.0; 4];
        for (number, sample) in numbers.iter_mut().zip(self.each_sample(&value.to_bytes())) {
            *number = self.sample.number(sample);
        }
        Samples { numbers, channels: self.channels }
    }

    /// Returns the samples of a value for computation; those of 64-bit integers as differences from
    /// another value's. See [`Sample::relative_to`].
    pub fn samples_from(self, base: Value, value: Value) -> Samples {
        let mut numbers = [0.0; 4];
        let (bytes, base) = (value.to_bytes(), base.to_bytes());
        let samples = self.each_sample(&bytes).zip(self.each_sample(&base));
        for (number, (sample, base)) in numbers.iter_mut().zip(samples) {
            *number = with_sample_type!(self.sample, S => S::read(sample).relative_to(S::read(base)));
        }
        Samples { numbers, channels: self.channels }
    }

    /// Returns the value nearest to a result that was computed with [`ValueType::samples_from`].
    /// Integers are rounded half up.
    pub fn nearest_from(self, base: Value, number: impl Fn(usize) -> f64) -> Value {
        let (mut bytes, base) = ([0; MAX_VALUE_SIZE], base.to_bytes());
        let size = self.sample.size();
        for (channel, base) in self.each_sample(&base).enumerate() {
            let sample = &mut bytes[channel * size..][..size];
            with_sample_type!(self.sample, S => S::from_relative(S::read(base), number(channel)).write(sample));
        }
        Value::from_wide(u128::from_le_bytes(bytes))
    }

    /// Appends the samples that many values have in a channel; NaN for missing samples and
    /// transparent cells.
    pub fn push_numbers(self, channel: usize, bytes: &[u8], numbers: &mut Vec<f64>) {
        let size = self.sample.size();
        let (first, width) = (channel * size, self.size());
        let start = numbers.len();
        with_sample_type!(self.sample, S => {
            numbers.extend(bytes.chunks_exact(width).map(|value| S::read(&value[first..]).to_f64()));
        });
        if self.is_masked() {
            for (number, value) in numbers[start..].iter_mut().zip(bytes.chunks_exact(width)) {
                if !self.mask.present(size, value)[channel] {
                    *number = f64::NAN;
                }
            }
        }
    }

    /// Returns the value whose samples are nearest to the numbers that a function returns for each
    /// channel.
    #[inline]
    pub fn nearest(self, number: impl Fn(usize) -> f64) -> Value {
        let mut bytes = [0; MAX_VALUE_SIZE];
        let size = self.sample.size();
        for channel in 0..usize::from(self.channels) {
            self.sample.write_nearest(number(channel), &mut bytes[channel * size..][..size]);
        }
        Value::from_wide(u128::from_le_bytes(bytes))
    }

    /// Returns the value whose samples are nearest to the exact numbers that a function returns for
    /// each channel.
    pub fn nearest_numbers(self, number: impl Fn(usize) -> Number) -> Value {
        let mut bytes = [0; MAX_VALUE_SIZE];
        let size = self.sample.size();
        for channel in 0..usize::from(self.channels) {
            self.sample.write_nearest_number(number(channel), &mut bytes[channel * size..][..size]);
        }
        Value::from_wide(u128::from_le_bytes(bytes))
    }

    /// Returns the value with exactly these samples, one per channel; `None` if there is no such
    /// value.
    pub fn exact(self, numbers: &[Number]) -> Option<Value> {
        let fits = numbers.len() == usize::from(self.channels)
            && numbers.iter().all(|number| self.sample.can_hold(*number));
        fits.then(|| self.nearest_numbers(|channel| numbers[channel]))
    }

    /// Returns the value with this number in every channel; `None` if the type cannot hold it.
    pub fn splat(self, number: impl Into<Number>) -> Option<Value> {
        let number = number.into();
        (self.is_supported() && self.sample.can_hold(number)).then(|| self.nearest_numbers(|_| number))
    }

    /// Whether any sample is NaN. Such a value is VOID.
    #[inline]
    pub fn is_nan(self, value: Value) -> bool {
        let [low, high] = value.words;
        // The padding after the last channel is zero, which is not NaN.
        match self.sample {
            SampleType::F32 => {
                let is_nan = |word: u64| {
                    f32::from_bits(word as u32).is_nan() || f32::from_bits((word >> 32) as u32).is_nan()
                };
                is_nan(low) || is_nan(high)
            }
            SampleType::F64 => f64::from_bits(low).is_nan() || f64::from_bits(high).is_nan(),
            _ => false,
        }
    }

    /// Returns a key that orders values: channel by channel, by number, then (for floats) by bits
    /// as in `f64::total_cmp`.
    #[inline]
    pub fn order_key(self, value: Value) -> u128 {
        let bits = 8 * self.sample.size();
        let bytes = value.to_bytes();
        self.each_sample(&bytes)
            .fold(0, |key, sample| key << bits | u128::from(self.sample.order_key(sample)))
    }

    /// Compares values in a total order: channel by channel, by number, then (for floats) by bits
    /// as in `f64::total_cmp`.
    #[inline]
    pub fn order(self, a: Value, b: Value) -> Ordering {
        self.order_key(a).cmp(&self.order_key(b))
    }

    /// Returns the smaller sample of each channel.
    #[inline]
    pub fn min(self, a: Value, b: Value) -> Value {
        self.choose(a, b, Ordering::Less)
    }

    /// Returns the larger sample of each channel.
    #[inline]
    pub fn max(self, a: Value, b: Value) -> Value {
        self.choose(a, b, Ordering::Greater)
    }

    /// Returns for each channel the sample of `b` if it compares to that of `a` as `wanted`,
    /// otherwise that of `a`.
    fn choose(self, a: Value, b: Value, wanted: Ordering) -> Value {
        let (mut bytes, others) = (a.to_bytes(), b.to_bytes());
        let size = self.sample.size();
        for start in (0..self.size()).step_by(size) {
            let other = &others[start..][..size];
            if self.sample.order_key(other).cmp(&self.sample.order_key(&bytes[start..])) == wanted {
                bytes[start..][..size].copy_from_slice(other);
            }
        }
        Value::from_wide(u128::from_le_bytes(bytes))
    }

    /// Formats a value: its samples, in brackets.
    pub fn show(self, value: Value) -> String {
        let samples: Vec<String> = self.numbers(value).iter().map(Number::to_string).collect();
        format!("[{}]", samples.join(", "))
    }
}

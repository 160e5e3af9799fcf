//! Samples that do not count: nodata in single channels of a cell, and all samples of transparent
//! cells.

use super::erased::{MAX_VALUE_SIZE, Value};
use super::number::Number;
use super::value_type::{Mask, ValueType};

impl ValueType {
    /// Returns the type of values in which a sample equal to `nodata` is missing.
    ///
    /// Returns a type without a mask if no sample can be `nodata`, or if there is one channel:
    /// cells with nodata are then VOID.
    #[must_use]
    pub fn with_missing(self, nodata: impl Into<Number>) -> ValueType {
        let splat = self.splat(nodata).filter(|value| self.channels > 1 && !self.is_nan(*value));
        let mask = splat.map_or(Mask::None, |value| {
            let mut sample = [0; 8];
            let size = self.sample.size();
            sample[..size].copy_from_slice(&value.to_bytes()[..size]);
            Mask::Missing(sample)
        });
        ValueType { mask, ..self }
    }

    /// Returns the type of values whose last channel is opacity. Cells with an opacity of 0 are
    /// transparent.
    ///
    /// Returns a type without a mask if there is one channel.
    #[must_use]
    pub const fn with_alpha(self) -> ValueType {
        let mask = if self.channels > 1 { Mask::Alpha } else { Mask::None };
        ValueType { mask, ..self }
    }

    /// Returns the type without a mask: all samples count.
    #[must_use]
    #[inline]
    pub const fn without_mask(self) -> ValueType {
        ValueType { mask: Mask::None, ..self }
    }

    /// Whether cells may lack samples.
    #[inline]
    pub const fn is_masked(self) -> bool {
        !matches!(self.mask, Mask::None)
    }

    /// Whether a value is transparent: its last channel is opacity, and 0.
    #[inline]
    pub fn is_transparent(self, value: Value) -> bool {
        self.mask == Mask::Alpha && self.present(value) == [false; 4]
    }

    /// Returns the mean of no samples: missing ones, or transparent black. `None` if all samples
    /// count.
    #[inline]
    pub fn mean_of_none(self) -> Option<Value> {
        match self.mask {
            Mask::None => None,
            Mask::Missing(_) => self.all_missing(),
            Mask::Alpha => Some(Value::ZERO),
        }
    }

    /// Returns the value whose samples are all missing; `None` if single samples cannot be missing.
    #[inline]
    pub fn all_missing(self) -> Option<Value> {
        let Mask::Missing(sample) = self.mask else { return None };
        let size = self.sample.size();
        let mut bytes = [0; MAX_VALUE_SIZE];
        for channel in bytes[..self.size()].chunks_exact_mut(size) {
            channel.copy_from_slice(&sample[..size]);
        }
        Some(Value::from_bytes(&bytes[..self.size()]))
    }

    /// Returns for each channel whether its sample counts.
    #[inline]
    pub fn present(self, value: Value) -> [bool; 4] {
        match self.mask {
            Mask::None => [true; 4],
            mask => mask.present(self.sample.size(), &value.to_bytes()[..self.size()]),
        }
    }

    /// Assembles a value from the sample of each channel in the value that a function returns for
    /// it.
    #[inline]
    pub fn by_channel(self, value: impl Fn(usize) -> Value) -> Value {
        let size = self.sample.size();
        let mut bytes = [0; MAX_VALUE_SIZE];
        for (channel, sample) in bytes[..self.size()].chunks_exact_mut(size).enumerate() {
            sample.copy_from_slice(&value(channel).to_bytes()[channel * size..][..size]);
        }
        Value::from_bytes(&bytes[..self.size()])
    }

    /// Returns the value with zeros for missing samples, which add nothing to sums.
    #[inline]
    pub fn with_zeros(self, value: Value) -> Value {
        let present = self.present(value);
        if present == [true; 4] {
            return value;
        }
        self.by_channel(|channel| if present[channel] { value } else { Value::ZERO })
    }

    /// Combines values channel by channel, and skips samples that do not count; `None` without
    /// values.
    #[inline]
    pub fn join_all(
        self,
        values: impl Iterator<Item = Value>,
        join: fn(ValueType, Value, Value) -> Value,
    ) -> Option<Value> {
        let joined = values.reduce(|a, b| self.join_present(a, b, join))?;
        Some(if self.is_transparent(joined) { Value::ZERO } else { joined })
    }

    /// Combines two values channel by channel. If one sample is missing, the result is the other.
    #[inline]
    pub fn join_present(self, a: Value, b: Value, join: fn(ValueType, Value, Value) -> Value) -> Value {
        let both = join(self, a, b);
        if !self.is_masked() {
            return both;
        }
        let (in_a, in_b) = (self.present(a), self.present(b));
        self.by_channel(|channel| match (in_a[channel], in_b[channel]) {
            (true, true) => both,
            (false, true) => b,
            _ => a,
        })
    }
}

impl Mask {
    /// Returns for each channel whether its sample counts; samples have `sample_size` bytes.
    #[inline]
    pub fn present(self, sample_size: usize, bytes: &[u8]) -> [bool; 4] {
        match self {
            Mask::None => [true; 4],
            Mask::Missing(missing) => {
                let mut present = [true; 4];
                for (flag, sample) in present.iter_mut().zip(bytes.chunks_exact(sample_size)) {
                    *flag = sample != &missing[..sample_size];
                }
                present
            }
            Mask::Alpha => {
                let (last, rest) = bytes.split_last().expect("values have bytes");
                let rest = &rest[rest.len() + 1 - sample_size..];
                // Minus zero is zero, too. In multi-channel types only floats have four bytes.
                let sign = if sample_size == 4 { 0x80 } else { 0 };
                [last & !sign != 0 || rest.iter().any(|byte| *byte != 0); 4]
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::value::SampleType;

    #[test]
    fn samples_are_missing_channel_by_channel() {
        let rgb = ValueType::new(SampleType::U8, 3).with_missing(9.0);
        let value = Value::from([9u8, 0, 7]);
        assert_eq!(rgb.present(value), [false, true, true, true]);
        assert_eq!(rgb.with_zeros(value), Value::from([0u8, 0, 7]));
        assert_eq!(rgb.all_missing(), Some(Value::from([9u8; 3])));
        let least = rgb.join_present(value, Value::from([200u8, 9, 5]), ValueType::min);
        assert_eq!(least, Value::from([200u8, 0, 5]));
        let floats = ValueType::new(SampleType::F32, 2).with_missing(-9999.0);
        assert_eq!(floats.present(Value::from([1.0f32, -9999.0])), [true, false, true, true]);
        let grey = ValueType::new(SampleType::U8, 1);
        // Types from files may have any number of channels.
        let unsupported = ValueType::new(SampleType::F32, 255);
        assert_eq!((unsupported.splat(1.0), unsupported.with_missing(1.0)), (None, unsupported));
        for none in [rgb.without_mask().with_missing(256.0), grey.with_missing(0.0), grey.with_alpha()] {
            assert_eq!((none.mask, none.present(value)), (Mask::None, [true; 4]));
        }
    }

    #[test]
    fn transparent_cells_have_no_samples_that_count() {
        let rgba = ValueType::new(SampleType::U16, 4).with_alpha();
        let [clear, faint] = [Value::from([7u16, 8, 9, 0]), Value::from([0u16, 0, 0, 1])];
        assert_eq!([clear, faint].map(|value| rgba.present(value)), [[false; 4], [true; 4]]);
        assert!(rgba.is_transparent(clear) && !rgba.without_mask().is_transparent(clear));
        assert_eq!(rgba.with_zeros(clear), Value::ZERO);
        assert_eq!(rgba.join_present(clear, faint, ValueType::max), faint);
        assert_eq!((rgba.all_missing(), rgba.mean_of_none()), (None, Some(Value::ZERO)));
        let floats = ValueType::new(SampleType::F32, 2).with_alpha();
        let clear = [0.0, -0.0, 1e-40].map(|alpha| floats.is_transparent(Value::from([7.0f32, alpha])));
        assert_eq!(clear, [true, true, false]);
    }
}

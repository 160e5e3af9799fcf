//! Samples that are missing: those that have the nodata number in one channel of a cell, while others have a sample.

use super::erased::{MAX_VALUE_SIZE, Value};
use super::number::Number;
use super::value_type::ValueType;

impl ValueType {
    /// The type of values of several channels in which a sample that is `nodata` is missing; the same type if no
    /// sample can be that, or there is one channel, where such cells are VOID.
    #[must_use]
    pub fn with_missing(self, nodata: impl Into<Number>) -> ValueType {
        let splat = self.splat(nodata).filter(|value| self.channels > 1 && !self.is_nan(*value));
        let missing = splat.map(|value| {
            let mut sample = [0; 8];
            let size = self.sample.size();
            sample[..size].copy_from_slice(&value.to_bytes()[..size]);
            sample
        });
        ValueType { missing, ..self }
    }

    /// The type without missing samples.
    #[must_use]
    #[inline]
    pub const fn without_missing(self) -> ValueType {
        ValueType { missing: None, ..self }
    }

    /// The value all of whose samples are missing, if samples can be.
    #[inline]
    pub fn all_missing(self) -> Option<Value> {
        let sample = self.missing?;
        let size = self.sample.size();
        let mut bytes = [0; MAX_VALUE_SIZE];
        for channel in bytes[..self.size()].chunks_exact_mut(size) {
            channel.copy_from_slice(&sample[..size]);
        }
        Some(Value::from_bytes(&bytes[..self.size()]))
    }

    /// Which channels of a value have a sample.
    #[inline]
    pub fn present(self, value: Value) -> [bool; 4] {
        let Some(missing) = self.missing else { return [true; 4] };
        let size = self.sample.size();
        let mut present = [true; 4];
        for (flag, sample) in present.iter_mut().zip(value.to_bytes()[..self.size()].chunks_exact(size)) {
            *flag = sample != &missing[..size];
        }
        present
    }

    /// The value with the samples that other values have in its channels.
    #[inline]
    pub fn by_channel(self, value: impl Fn(usize) -> Value) -> Value {
        let size = self.sample.size();
        let mut bytes = [0; MAX_VALUE_SIZE];
        for (channel, sample) in bytes[..self.size()].chunks_exact_mut(size).enumerate() {
            sample.copy_from_slice(&value(channel).to_bytes()[channel * size..][..size]);
        }
        Value::from_bytes(&bytes[..self.size()])
    }

    /// The value with zeros in place of samples that are missing, which add nothing to sums.
    #[inline]
    pub fn with_zeros(self, value: Value) -> Value {
        let present = self.present(value);
        if present == [true; 4] {
            return value;
        }
        self.by_channel(|channel| if present[channel] { value } else { Value::ZERO })
    }

    /// Joins two values, channel by channel; where one sample is missing it is the other.
    #[inline]
    pub fn join_present(self, a: Value, b: Value, join: fn(ValueType, Value, Value) -> Value) -> Value {
        let both = join(self, a, b);
        if self.missing.is_none() {
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
        for none in
            [rgb.without_missing().with_missing(256.0), ValueType::new(SampleType::U8, 1).with_missing(0.0)]
        {
            assert_eq!((none.missing, none.present(value)), (None, [true; 4]));
        }
    }
}

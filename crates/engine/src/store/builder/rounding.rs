//! Rounding of cells to multiples of a power of two, so that they have fewer digits to store.

use spinney_base::value::{Mask, SampleType, Value, ValueType};
use spinney_base::{Error, Result};

/// Rounds samples so that each differs from the original by at most the allowed error.
#[derive(Clone, Copy, Debug)]
pub(in crate::store) struct Rounding {
    value_type: ValueType,
    /// Samples become multiples of two to this power.
    power: i32,
}

impl Rounding {
    /// Returns the rounding with a maximum error of `most`, a number above 0. `None` if nothing
    /// would be rounded.
    ///
    /// # Errors
    /// If `most` is not such a number.
    pub(in crate::store) fn new(value_type: ValueType, most: f64) -> Result<Option<Rounding>> {
        if !(most > 0.0 && most.is_finite()) {
            return Err(Error::invalid("maximum error", most.to_string(), "a number above 0"));
        }
        // The maximum error is half of the rounding unit. (The exponent is read from the number's
        // bits.)
        let power = ((2.0 * most).to_bits() >> 52) as i32 - 1023;
        let is_nothing = !value_type.sample.is_float() && power < 1;
        Ok((!is_nothing && power > -1023).then_some(Rounding { value_type, power }))
    }

    /// Rounds all samples of some values, except opacity and samples that mark missing ones.
    pub(super) fn round(&self, values: &mut [u8]) {
        let (width, size) = (self.value_type.size(), self.value_type.sample.size());
        let missing = match self.value_type.mask {
            Mask::Missing(sample) => Some(sample),
            Mask::None | Mask::Alpha => None,
        };
        // (Opacity determines which cells count, so it is not rounded.)
        let samples = match self.value_type.mask {
            Mask::Alpha => width - size,
            _ => width,
        };
        for value in values.chunks_exact_mut(width) {
            for sample in value[..samples].chunks_exact_mut(size) {
                if missing.is_none_or(|missing| missing[..size] != *sample) {
                    self.round_sample(sample);
                }
            }
        }
    }

    /// Rounds one value.
    pub(super) fn rounded(&self, value: Value) -> Value {
        let mut bytes = value.to_bytes();
        self.round(&mut bytes[..self.value_type.size()]);
        Value::from_bytes(&bytes)
    }

    #[inline]
    fn round_sample(&self, bytes: &mut [u8]) {
        macro_rules! whole {
            ($type:ty) => {{
                if let Some(bytes) = bytes.first_chunk_mut() {
                    *bytes = self.whole::<$type>(<$type>::from_le_bytes(*bytes).into()).to_le_bytes();
                }
            }};
        }
        match self.value_type.sample {
            SampleType::U8 => whole!(u8),
            SampleType::I8 => whole!(i8),
            SampleType::U16 => whole!(u16),
            SampleType::I16 => whole!(i16),
            SampleType::U32 => whole!(u32),
            SampleType::I32 => whole!(i32),
            SampleType::U64 => whole!(u64),
            SampleType::I64 => whole!(i64),
            SampleType::F32 => {
                if let Some(bytes) = bytes.first_chunk_mut() {
                    *bytes = (self.float(f64::from(f32::from_le_bytes(*bytes))) as f32).to_le_bytes();
                }
            }
            SampleType::F64 => {
                if let Some(bytes) = bytes.first_chunk_mut() {
                    *bytes = self.float(f64::from_le_bytes(*bytes)).to_le_bytes();
                }
            }
        }
    }

    /// Returns the nearest multiple that the type can represent.
    #[inline]
    fn whole<T: TryFrom<i128>>(&self, number: i128) -> T {
        let power = self.power.min(64) as u32;
        let half = 1 << power >> 1;
        let nearest = (number + half) >> power << power;
        // (The nearest multiple may exceed the type's maximum. The multiple below it may be as
        // near.)
        let below = nearest - (1 << power);
        let fits = |number: i128| T::try_from(number).ok();
        let below = || fits(below).filter(|_| number - below <= half);
        fits(nearest).or_else(below).or_else(|| fits(number)).expect("it was one")
    }

    #[inline]
    fn float(&self, number: f64) -> f64 {
        let step = f64::from_bits(((1023 + i64::from(self.power)) as u64) << 52);
        let rounded = (number / step).round() * step;
        // (NaN, infinity, and numbers whose rounding overflows are unchanged; negative zero becomes
        // zero.)
        if rounded.is_finite() { rounded + 0.0 } else { number }
    }
}

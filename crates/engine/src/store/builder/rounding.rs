//! Cells rounded to multiples of a power of two, so that they have fewer digits to store.

use spinney_base::value::{Mask, SampleType, Value, ValueType};
use spinney_base::{Error, Result};

/// Rounds samples so that none differs from what it was by more than an error that is allowed.
#[derive(Clone, Copy, Debug)]
pub(in crate::store) struct Rounding {
    value_type: ValueType,
    /// Samples become multiples of two to this power.
    power: i32,
}

impl Rounding {
    /// By at most an error, which must be a number above 0. `None` if nothing would be rounded by so little.
    ///
    /// # Errors
    /// If it is not such a number.
    pub(in crate::store) fn new(value_type: ValueType, most: f64) -> Result<Option<Rounding>> {
        if !(most > 0.0 && most.is_finite()) {
            return Err(Error::invalid("greatest error", most.to_string(), "a number above 0"));
        }
        // Halves of steps are the greatest errors. (The exponent of the number, in its bits.)
        let power = ((2.0 * most).to_bits() >> 52) as i32 - 1023;
        let is_nothing = !value_type.sample.is_float() && power < 1;
        Ok((!is_nothing && power > -1023).then_some(Rounding { value_type, power }))
    }

    /// Rounds all samples of some values, but for those that mean missing, and opacity.
    pub(super) fn round(&self, values: &mut [u8]) {
        let (width, size) = (self.value_type.size(), self.value_type.sample.size());
        let missing = match self.value_type.mask {
            Mask::Missing(sample) => Some(sample),
            Mask::None | Mask::Alpha => None,
        };
        // (Opacity tells which cells count: it stays as it is.)
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

    /// The nearest multiple that the type has.
    #[inline]
    fn whole<T: TryFrom<i128>>(&self, number: i128) -> T {
        let power = self.power.min(64) as u32;
        let half = 1 << power >> 1;
        let nearest = (number + half) >> power << power;
        // (Beyond the greatest number of the type there is none; the multiple below may be as near.)
        let below = nearest - (1 << power);
        let fits = |number: i128| T::try_from(number).ok();
        let below = || fits(below).filter(|_| number - below <= half);
        fits(nearest).or_else(below).or_else(|| fits(number)).expect("it was one")
    }

    #[inline]
    fn float(&self, number: f64) -> f64 {
        let step = f64::from_bits(((1023 + i64::from(self.power)) as u64) << 52);
        let rounded = (number / step).round() * step;
        // (A number that is none stays; zeros have no sign.)
        if rounded.is_finite() { rounded + 0.0 } else { number }
    }
}

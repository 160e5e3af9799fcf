//! Numbers in JSON, for readers with 64-bit integers, and for JavaScript, whose integers are exact
//! only up to 2^53 - 1.

use serde_json::{Value, json};
use spinney_base::value::{Number, SampleType};

/// Maximum integer that JavaScript numbers represent exactly, like all smaller ones.
const MAX_EXACT: u64 = (1 << 53) - 1;

/// Representation of numbers in JSON.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JsonNumbers {
    /// As JSON numbers, and `null` if they are not finite, since JSON cannot represent these.
    Plain,
    /// As JSON numbers where JavaScript reads them exactly. Otherwise `{"$big": "..."}`, which
    /// becomes a BigInt, or `{"$float": "..."}` for infinite numbers. Samples of 64-bit integer
    /// types are always `$big`.
    Marked,
}

impl JsonNumbers {
    /// Returns an integer that JavaScript turns into a BigInt.
    pub fn big(number: impl ToString) -> Value {
        json!({ "$big": number.to_string() })
    }

    /// Returns a count.
    pub fn count(self, count: u64) -> Value {
        if self == JsonNumbers::Marked && count > MAX_EXACT { Self::big(count) } else { json!(count) }
    }

    /// Returns a sample.
    pub fn sample(self, number: Number, of: SampleType) -> Value {
        let is_marked = self == JsonNumbers::Marked;
        match number {
            number if is_marked && is_long(of) => {
                number.to_integer().map_or_else(|| json!(number), Self::big)
            }
            Number::Float(float) if is_marked && float.is_infinite() => {
                json!({ "$float": float.to_string() })
            }
            number => json!(number),
        }
    }

    /// Returns the value of a class, as an integer if it is one.
    pub fn class(self, value: Number, of: SampleType) -> Value {
        if self == JsonNumbers::Plain {
            return class_as_json(value);
        }
        match value.to_integer() {
            _ if is_long(of) => self.sample(value, of),
            Some(whole) if whole.unsigned_abs() <= u128::from(MAX_EXACT) => json!(whole as i64),
            Some(whole) if !of.is_float() => Self::big(whole),
            _ => self.sample(value, of),
        }
    }
}

fn is_long(of: SampleType) -> bool {
    matches!(of, SampleType::U64 | SampleType::I64)
}

/// Returns the value of a class, as an integer if it is one.
pub fn class_as_json(value: Number) -> Value {
    /// Up to this number, floating-point numbers represent all integers.
    const MOST: f64 = 9_007_199_254_740_992.0;
    match value {
        Number::Float(float) if float.fract() == 0.0 && float.abs() <= MOST => json!(float as i64),
        value => json!(value),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_javascript_cannot_read_is_marked() {
        use JsonNumbers::{Marked, Plain};
        assert_eq!(Plain.count(u64::MAX), json!(u64::MAX));
        assert_eq!(Marked.count(u64::MAX), json!({ "$big": u64::MAX.to_string() }));
        assert_eq!(Marked.count(MAX_EXACT), json!(MAX_EXACT));
        assert_eq!(
            Marked.sample(Number::Float(f64::NEG_INFINITY), SampleType::F32),
            json!({ "$float": "-inf" })
        );
        assert_eq!(Plain.sample(Number::Float(f64::NEG_INFINITY), SampleType::F32), Value::Null);
        assert_eq!(Marked.class(Number::Float(3.0), SampleType::F32), json!(3));
        assert_eq!(Marked.class(Number::from(3u64), SampleType::U64), json!({ "$big": "3" }));
        assert_eq!(Plain.class(Number::from(3u64), SampleType::U64), json!(3));
    }
}

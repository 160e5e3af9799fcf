//! Exact numbers, the type-independent form of single samples in the API.

use std::cmp::Ordering;
use std::fmt;
use std::num::ParseFloatError;
use std::str::FromStr;

use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A number that can hold any sample: a signed or unsigned 64-bit integer, or an f64.
///
/// Numbers are compared by value, not by representation: 3 and 3.0 are equal, and an integer that
/// is not exact in an f64 is equal to no f64. The order is total, as in `f64::total_cmp`: -0.0 is
/// less than 0.
///
/// ```
/// use spinney::Number;
/// let large: Number = "9223372036854775811".parse()?;
/// assert_eq!(large.to_string(), "9223372036854775811");
/// assert!(large > Number::from(9_223_372_036_854_775_810u64));
/// assert!(Number::from(3) == 3.0 && large != large.to_f64());
/// # Ok::<(), std::num::ParseFloatError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub enum Number {
    /// A non-negative integer.
    Unsigned(u64),
    /// A negative integer.
    Signed(i64),
    /// Any number, as in floating samples.
    Float(f64),
}

impl Number {
    /// Not a number.
    pub const NAN: Number = Number::Float(f64::NAN);

    /// Returns the nearest f64.
    #[inline]
    pub fn to_f64(self) -> f64 {
        match self {
            Number::Unsigned(number) => number as f64,
            Number::Signed(number) => number as f64,
            Number::Float(number) => number,
        }
    }

    /// Returns the number as an integer; `None` if it is not integral, is -0.0, or exceeds the
    /// range of 64-bit integers.
    pub fn to_integer(self) -> Option<i128> {
        match self {
            Number::Unsigned(number) => Some(number.into()),
            Number::Signed(number) => Some(number.into()),
            Number::Float(number) => {
                let whole = number as i128;
                let is_exact = whole as f64 == number && !is_negative_zero(number);
                let fits = (i128::from(i64::MIN)..=i128::from(u64::MAX)).contains(&whole);
                (is_exact && fits).then_some(whole)
            }
        }
    }

    /// Whether the number is finite.
    #[inline]
    pub fn is_finite(self) -> bool {
        !matches!(self, Number::Float(number) if !number.is_finite())
    }

    /// Whether the number is NaN.
    #[inline]
    pub fn is_nan(self) -> bool {
        matches!(self, Number::Float(number) if number.is_nan())
    }

    /// Returns the number, with -0.0 replaced by 0.
    #[inline]
    #[must_use]
    pub fn with_plain_zero(self) -> Number {
        if matches!(self, Number::Float(number) if number == 0.0) { Number::Unsigned(0) } else { self }
    }
}

fn is_negative_zero(number: f64) -> bool {
    number == 0.0 && number.is_sign_negative()
}

/// Compares a 64-bit integer with an f64, exactly.
fn compare_mixed(integer: i128, float: f64) -> Ordering {
    if float.is_nan() {
        return if float.is_sign_negative() { Ordering::Greater } else { Ordering::Less };
    }
    // The cast saturates at the limits of i128, which are beyond all 64-bit integers.
    let below = float.floor();
    integer.cmp(&(below as i128)).then(match () {
        () if below < float => Ordering::Less,
        () if is_negative_zero(float) => Ordering::Greater,
        () => Ordering::Equal,
    })
}

impl Ord for Number {
    fn cmp(&self, other: &Number) -> Ordering {
        let integer = |number: Number| match number {
            Number::Unsigned(number) => Ok(i128::from(number)),
            Number::Signed(number) => Ok(i128::from(number)),
            Number::Float(number) => Err(number),
        };
        match (integer(*self), integer(*other)) {
            (Ok(a), Ok(b)) => a.cmp(&b),
            (Err(a), Err(b)) => a.total_cmp(&b),
            (Ok(a), Err(b)) => compare_mixed(a, b),
            (Err(a), Ok(b)) => compare_mixed(b, a).reverse(),
        }
    }
}

impl PartialOrd for Number {
    #[inline]
    fn partial_cmp(&self, other: &Number) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Number {
    #[inline]
    fn eq(&self, other: &Number) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Number {}

impl PartialEq<f64> for Number {
    #[inline]
    fn eq(&self, other: &f64) -> bool {
        *self == Number::Float(*other)
    }
}

impl PartialEq<Number> for f64 {
    #[inline]
    fn eq(&self, other: &Number) -> bool {
        other == self
    }
}

impl Default for Number {
    #[inline]
    fn default() -> Number {
        Number::Unsigned(0)
    }
}

macro_rules! from_integers {
    ($($type:ident)*) => { $(
        impl From<$type> for Number {
            #[inline]
            #[allow(unused_comparisons)] // of types without a sign
            fn from(number: $type) -> Number {
                if number < 0 { Number::Signed(number as i64) } else { Number::Unsigned(number as u64) }
            }
        }
    )* };
}

from_integers!(u8 i8 u16 i16 u32 i32 u64 i64);

impl From<f32> for Number {
    #[inline]
    fn from(number: f32) -> Number {
        Number::Float(number.into())
    }
}

impl From<f64> for Number {
    #[inline]
    fn from(number: f64) -> Number {
        Number::Float(number)
    }
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Number::Unsigned(number) => number.fmt(f),
            Number::Signed(number) => number.fmt(f),
            Number::Float(number) => number.fmt(f),
        }
    }
}

impl FromStr for Number {
    type Err = ParseFloatError;

    /// Parses integers exactly, including those with a fraction of zeros (`5.0`), and other numbers
    /// to the nearest f64.
    fn from_str(text: &str) -> Result<Number, ParseFloatError> {
        let whole = match text.split_once('.') {
            Some((whole, zeros)) if !zeros.is_empty() && zeros.bytes().all(|byte| byte == b'0') => whole,
            _ => text,
        };
        if let Ok(number) = whole.parse::<u64>() {
            return Ok(Number::Unsigned(number));
        }
        match whole.parse::<i64>() {
            // `-0` is the negative zero of floating samples.
            Ok(number) if number < 0 => Ok(Number::Signed(number)),
            _ => text.parse().map(Number::Float),
        }
    }
}

/// Representation in binary formats.
#[derive(Serialize, Deserialize)]
#[serde(rename = "Number")]
enum BinaryNumber {
    Unsigned(u64),
    Signed(i64),
    Float(f64),
}

impl Serialize for Number {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match (*self, serializer.is_human_readable()) {
            (Number::Unsigned(number), true) => serializer.serialize_u64(number),
            (Number::Signed(number), true) => serializer.serialize_i64(number),
            (Number::Float(number), true) => serializer.serialize_f64(number),
            (Number::Unsigned(number), false) => BinaryNumber::Unsigned(number).serialize(serializer),
            (Number::Signed(number), false) => BinaryNumber::Signed(number).serialize(serializer),
            (Number::Float(number), false) => BinaryNumber::Float(number).serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Number, D::Error> {
        if deserializer.is_human_readable() {
            return deserializer.deserialize_any(AnyNumber);
        }
        Ok(match BinaryNumber::deserialize(deserializer)? {
            BinaryNumber::Unsigned(number) => number.into(),
            BinaryNumber::Signed(number) => number.into(),
            BinaryNumber::Float(number) => number.into(),
        })
    }
}

struct AnyNumber;

impl Visitor<'_> for AnyNumber {
    type Value = Number;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number")
    }

    fn visit_u64<E: de::Error>(self, number: u64) -> Result<Number, E> {
        Ok(number.into())
    }

    fn visit_i64<E: de::Error>(self, number: i64) -> Result<Number, E> {
        Ok(number.into())
    }

    fn visit_f64<E: de::Error>(self, number: f64) -> Result<Number, E> {
        Ok(number.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_ordered_by_value() {
        let two_53 = 1u64 << 53;
        // In ascending order. The numbers of each inner list are equal.
        let ascending: &[&[Number]] = &[
            &[Number::Float(-f64::NAN)],
            &[Number::Float(f64::NEG_INFINITY)],
            &[Number::Float(-1e300)],
            &[i64::MIN.into(), (i64::MIN as f64).into()],
            &[(i64::MIN + 1).into()],
            &[(-1).into(), (-1.0).into()],
            &[(-0.5).into()],
            &[(-0.0).into()],
            &[0.into(), 0.0.into(), Number::Signed(0)],
            &[Number::Float(5e-324)],
            &[1.into(), 1.0.into(), Number::Signed(1)],
            &[1.5.into()],
            &[two_53.into(), (two_53 as f64).into()],
            &[(two_53 + 1).into()],
            &[(two_53 + 2).into(), ((two_53 + 2) as f64).into()],
            &[(u64::MAX - 1).into()],
            &[u64::MAX.into()],
            &[Number::Float(2f64.powi(64))],
            &[Number::Float(f64::INFINITY)],
            &[Number::NAN],
        ];
        for (i, first) in ascending.iter().enumerate() {
            for (j, second) in ascending.iter().enumerate() {
                for (a, b) in first.iter().flat_map(|a| second.iter().map(move |b| (a, b))) {
                    assert_eq!(a.cmp(b), i.cmp(&j), "{a:?} {b:?}");
                    assert_eq!(a == b, i == j);
                }
            }
        }
    }

    #[test]
    fn strings_round_trip() {
        for text in [
            "0",
            "-1",
            "18446744073709551615",
            "-9223372036854775808",
            "9007199254740993",
            "0.25",
            "NaN",
            "inf",
        ] {
            assert_eq!(text.parse::<Number>().unwrap().to_string(), text);
        }
        for (text, number) in [
            ("+5", Number::Unsigned(5)),
            ("9007199254740993.000", Number::Unsigned(9_007_199_254_740_993)),
            ("-3.0", Number::Signed(-3)),
            ("-0", Number::Float(-0.0)),
            ("-0.0", Number::Float(-0.0)),
            ("1e3", Number::Float(1000.0)),
            ("18446744073709551616", Number::Float(2f64.powi(64))),
        ] {
            let found: Number = text.parse().unwrap();
            assert_eq!(format!("{found:?}"), format!("{number:?}"), "{text}");
        }
        for text in ["", ".0", "-", "1.0.0", "five", "0x10"] {
            assert!(text.parse::<Number>().is_err() || text == ".0", "{text}");
        }
    }

    #[test]
    fn to_integer_converts_exact_integers_only() {
        assert_eq!(Number::from(3.0).to_integer(), Some(3));
        assert_eq!(Number::from(u64::MAX).to_integer(), Some(u64::MAX.into()));
        assert_eq!(Number::from(i64::MIN).to_integer(), Some(i64::MIN.into()));
        let none = [f64::NAN, f64::INFINITY, 0.5, -0.0, 2f64.powi(64), -2f64.powi(64), 1e300];
        assert!(none.into_iter().all(|number| Number::from(number).to_integer().is_none()));
    }
}

//! Numbers of serialized options as strings, for `#[serde(with = "spinney_base::text_fields")]`.
//!
//! Strings keep every digit, and they can hold NaN and infinities, which JSON lacks.

use serde::de::{DeserializeOwned, Error};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::value::Number;

/// A number, or options and arrays of numbers.
pub trait TextField: Sized {
    /// String representation.
    type Text: Serialize + DeserializeOwned;

    /// Converts the numbers to strings.
    fn to_text(&self) -> Self::Text;

    /// Parses the numbers. An error describes the string or count that was found.
    ///
    /// # Errors
    /// If a string is no number, or the count is wrong.
    fn of_text(text: Self::Text) -> Result<Self, String>;
}

macro_rules! numbers {
    ($($number:ty),*) => {
        $(impl TextField for $number {
            type Text = String;

            fn to_text(&self) -> String {
                self.to_string()
            }

            fn of_text(text: String) -> Result<$number, String> {
                text.parse().map_err(|_| format!("`{text}`, expected a number"))
            }
        })*
    };
}

numbers!(f32, f64, Number);

impl<T: TextField> TextField for Option<T> {
    type Text = Option<T::Text>;

    fn to_text(&self) -> Option<T::Text> {
        self.as_ref().map(T::to_text)
    }

    fn of_text(text: Option<T::Text>) -> Result<Option<T>, String> {
        text.map(T::of_text).transpose()
    }
}

impl<T: TextField, const N: usize> TextField for [T; N] {
    type Text = Vec<T::Text>;

    fn to_text(&self) -> Vec<T::Text> {
        self.iter().map(T::to_text).collect()
    }

    fn of_text(text: Vec<T::Text>) -> Result<[T; N], String> {
        let numbers = text.into_iter().map(T::of_text).collect::<Result<Vec<T>, String>>()?;
        numbers.try_into().map_err(|numbers: Vec<T>| format!("{} numbers, expected {N}", numbers.len()))
    }
}

/// Serializes a field.
///
/// # Errors
/// Those of the serializer.
pub fn serialize<T: TextField, S: Serializer>(field: &T, serializer: S) -> Result<S::Ok, S::Error> {
    field.to_text().serialize(serializer)
}

/// Deserializes a field.
///
/// # Errors
/// Those of the deserializer; also if a string is no number, or the count is wrong.
pub fn deserialize<'de, T: TextField, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    T::of_text(T::Text::deserialize(deserializer)?).map_err(D::Error::custom)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_all_digits() {
        let numbers = [[0.1 + 0.2, 1e-300, -0.0], [f64::MAX, f64::NEG_INFINITY, 1.0 / 3.0]];
        let again = <[[f64; 3]; 2]>::of_text(numbers.to_text()).unwrap();
        assert_eq!(again.map(|row| row.map(f64::to_bits)), numbers.map(|row| row.map(f64::to_bits)));
        assert!(f64::of_text(f64::NAN.to_text()).unwrap().is_nan());
        for number in [Number::from(u64::MAX), Number::from(i64::MIN), Number::from(0.1)] {
            assert_eq!(Option::of_text(Some(number).to_text()).unwrap(), Some(number));
        }
        assert_eq!(Option::<f64>::of_text(None), Ok(None));
    }

    #[test]
    fn other_strings_and_counts_are_refused() {
        assert_eq!(f64::of_text("x".into()), Err("`x`, expected a number".into()));
        let two = vec!["1".to_string(), "2".into()];
        assert_eq!(<[f64; 3]>::of_text(two), Err("2 numbers, expected 3".into()));
    }
}

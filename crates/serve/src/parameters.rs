//! Query parameters of an address.

use std::fmt::Display;
use std::str::FromStr;

use crate::failure::Failure;

/// Names and values; names are unique.
pub(crate) struct Parameters(Vec<(String, String)>);

/// Maximum size in bytes; styles are the longest parameters.
const MAX_BYTES: usize = 32 << 10;

impl Parameters {
    /// Parses the parameters of a query, whose names are `known`.
    ///
    /// # Errors
    /// If a parameter has another name, or is given twice.
    pub(crate) fn parse(query: Option<&str>, known: &[&str]) -> Result<Parameters, Failure> {
        let query = query.unwrap_or_default();
        if query.len() > MAX_BYTES {
            return Err(Failure::too_large(format!(
                "parameters: got {} bytes, expected at most {MAX_BYTES}",
                query.len()
            )));
        }
        let mut pairs: Vec<(String, String)> = Vec::new();
        for (name, value) in form_urlencoded::parse(query.as_bytes()) {
            if !known.contains(&&*name) {
                let name: String = name.chars().take(50).collect();
                return Err(Failure::bad(format!(
                    "parameter `{name}`: expected {}",
                    if known.is_empty() { "none".into() } else { known.join(", ") }
                )));
            }
            if pairs.iter().any(|(known_name, _)| *known_name == name) {
                return Err(Failure::bad(format!("{name}: is given twice, expected once")));
            }
            pairs.push((name.into_owned(), value.into_owned()));
        }
        Ok(Parameters(pairs))
    }

    /// Value of a parameter, if it is given.
    pub(crate) fn text(&self, name: &str) -> Option<&str> {
        self.0.iter().find(|(own, _)| own == name).map(|(_, value)| value.as_str())
    }

    /// Parsed value of a parameter, if it is given.
    pub(crate) fn value<T: FromStr<Err: Display>>(&self, name: &str) -> Result<Option<T>, Failure> {
        let parse = |text: &str| {
            text.trim().parse().map_err(|error: T::Err| Failure::bad(format!("{name}: {error}")))
        };
        self.text(name).map(parse).transpose()
    }

    /// Finite number, if it is given.
    pub(crate) fn number(&self, name: &str) -> Result<Option<f64>, Failure> {
        match self.value::<f64>(name)? {
            Some(number) if !number.is_finite() => {
                Err(Failure::bad(format!("{name}: got {number}, expected a finite number")))
            }
            number => Ok(number),
        }
    }

    /// Comma-separated values, if they are given.
    pub(crate) fn list<T: FromStr<Err: Display>>(&self, name: &str) -> Result<Option<Vec<T>>, Failure> {
        let parse = |text: &str| {
            let items = text.split(',').map(|item| item.trim().parse());
            items
                .collect::<Result<Vec<T>, T::Err>>()
                .map_err(|error| Failure::bad(format!("{name}: {error}")))
        };
        self.text(name).map(parse).transpose()
    }

    /// `N` comma-separated finite numbers, if they are given.
    pub(crate) fn numbers<const N: usize>(&self, name: &str) -> Result<Option<[f64; N]>, Failure> {
        let Some(list) = self.list::<f64>(name)? else { return Ok(None) };
        match <[f64; N]>::try_from(list) {
            Ok(numbers) if numbers.iter().all(|number| number.is_finite()) => Ok(Some(numbers)),
            _ => Err(Failure::bad(format!("{name}: expected {N} finite numbers, separated by commas"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_must_be_known_and_unique() {
        let parse = |query: &str| Parameters::parse(Some(query), &["x", "style"]);
        let found = parse("x=1.5&style=%7B%22a%22%3A1%7D").unwrap();
        assert_eq!(found.number("x").unwrap(), Some(1.5));
        assert_eq!(found.text("style"), Some("{\"a\":1}"));
        assert!(parse("y=1").is_err() && parse("x=1&x=2").is_err() && parse("x=1&style").is_ok());
        for wrong in ["x=", "x=a", "x=inf", "x=NaN", "x=1,2"] {
            assert!(parse(wrong).unwrap().number("x").is_err(), "{wrong}");
        }
        assert_eq!(parse("x=1,2").unwrap().numbers("x").unwrap(), Some([1.0, 2.0]));
        assert!(parse("x=1,2").unwrap().numbers::<3>("x").is_err());
    }
}

//! Cell values of features: collected in the first pass, numbered in the second.

use std::collections::BTreeMap;

use spinney_base::value::{DataKind, Number, SampleType, ValueType};
use spinney_base::{Error, Result};

use super::options::{FeatureValue, Overlaps, RasterizeOptions};
use crate::import::feature::FeatureAttribute;

/// Values of all features seen so far.
#[derive(Debug, Default)]
pub(super) struct Values {
    /// Whether there are floating-point numbers, integers and Booleans.
    has_reals: bool,
    has_integers: bool,
    has_booleans: bool,
    /// Minimum and maximum of all integers, including integral floating-point numbers.
    range: Option<[i128; 2]>,
    /// Strings, with their classes once all are known.
    strings: BTreeMap<String, Number>,
    /// A number that is not an integer, if there is one.
    fraction: Option<f64>,
}

/// Maximum number of named classes that metadata can hold.
const MAX_CLASSES: usize = 1 << 18;

impl Values {
    /// Adds an attribute value. [`Values::finish`] rejects mixed strings and numbers.
    ///
    /// # Errors
    /// If there are too many different strings.
    pub(super) fn add(&mut self, attribute: &FeatureAttribute) -> Result<()> {
        match attribute {
            FeatureAttribute::None => {}
            FeatureAttribute::Number(number) if number.is_nan() => {}
            FeatureAttribute::Integer(number) => {
                self.has_integers = true;
                self.add_integer((*number).into());
            }
            FeatureAttribute::Boolean(is) => {
                self.has_booleans = true;
                self.add_integer((*is).into());
            }
            FeatureAttribute::Number(number) => {
                self.has_reals = true;
                match number.fract() == 0.0 && number.abs() < 9e15 {
                    true => self.add_integer(*number as i128),
                    false => self.fraction = Some(*number),
                }
            }
            FeatureAttribute::Text(text) | FeatureAttribute::Json(text) => {
                if !self.strings.contains_key(text) {
                    self.strings.insert(text.clone(), Number::default());
                }
                if self.strings.len() > MAX_CLASSES {
                    let found = format!("more than {MAX_CLASSES} different strings");
                    return Err(Error::invalid("value", found, "an attribute with fewer, or with numbers"));
                }
            }
        }
        Ok(())
    }

    fn add_integer(&mut self, number: i128) {
        let [low, high] = self.range.unwrap_or([number; 2]);
        self.range = Some([low.min(number), high.max(number)]);
    }

    /// Numbers the strings in alphabetical order, or by the classes of the tree that features are
    /// laid over.
    ///
    /// # Errors
    /// If there are both strings and numbers; if the tree has no class of that name, or cannot hold
    /// a number.
    pub(super) fn finish(&mut self, name: &str, options: &RasterizeOptions) -> Result<()> {
        let has_numbers = self.has_reals || self.has_integers || self.has_booleans;
        if has_numbers && !self.strings.is_empty() {
            let text = self.strings.keys().next().cloned().unwrap_or_default();
            let found = format!("`{name}`, which has numbers and strings, such as `{text}`");
            return Err(Error::invalid("value", found, "an attribute with either numbers or strings"));
        }
        let Some(ground) = &options.ground else {
            for (class, number) in self.strings.values_mut().zip(1u64..) {
                *class = number.into();
            }
            let classes = self.strings.values().next_back().copied();
            return match options.sample.and_then(|sample| self.unfit(sample, classes)) {
                Some(number) => {
                    let found = format!("a type that cannot represent {number}, a value of `{name}`");
                    Err(Error::invalid("type", found, "a type that can represent all values"))
                }
                None => Ok(()),
            };
        };
        let classes = &ground.metadata.class_names;
        for (text, class) in &mut self.strings {
            let found = classes.iter().find(|(_, name)| *name == text);
            *class = *found.ok_or_else(|| unknown_class(text, classes))?.0;
        }
        let sample = ground.header.form.value.sample;
        match self.unfit(sample, None).filter(|_| !options.overlaps.is_computed()) {
            Some(number) => {
                let found = format!("`{name}`, which has the value {number}");
                Err(Error::invalid(
                    "value",
                    found,
                    format!("an attribute whose values {} can represent", ground.header.form.value),
                ))
            }
            None => Ok(()),
        }
    }

    /// Returns a number that an integer type cannot hold, among the collected ones and `other`.
    fn unfit(&self, sample: SampleType, other: Option<Number>) -> Option<Number> {
        let numbers = self.range.into_iter().flatten().map(number_of).chain(self.fraction.map(Number::from));
        numbers.chain(other).find(|number| !sample.is_float() && !sample.can_hold(*number))
    }

    /// Returns the cell number of an attribute value; `None` if it has no value.
    pub(super) fn number(&self, attribute: &FeatureAttribute) -> Option<Number> {
        Some(match attribute {
            FeatureAttribute::None => return None,
            FeatureAttribute::Number(number) if number.is_nan() => return None,
            FeatureAttribute::Integer(number) => (*number).into(),
            FeatureAttribute::Boolean(is) => u64::from(*is).into(),
            FeatureAttribute::Number(number) if number.fract() == 0.0 && number.abs() < 9e15 => {
                (*number as i64).into()
            }
            FeatureAttribute::Number(number) => (*number).into(),
            FeatureAttribute::Text(text) | FeatureAttribute::Json(text) => *self.strings.get(text)?,
        })
    }

    /// Returns the names of the classes made from strings.
    pub(super) fn class_names(&self) -> impl Iterator<Item = (Number, String)> {
        self.strings.iter().map(|(text, class)| (*class, text.clone()))
    }

    /// Returns type and kind of the cells. The type for an attribute depends as little as possible
    /// on its values, so that trees of similar files match: integers are i32, or i64 where needed,
    /// floating-point numbers f64.
    pub(super) fn form(&self, options: &RasterizeOptions) -> (ValueType, DataKind) {
        if let Some(ground) = &options.ground {
            return (ground.header.form.value, ground.header.kind);
        }
        let (sample, kind) = match options {
            options if options.fractions => (SampleType::F32, DataKind::Continuous),
            options if options.overlaps == Overlaps::Count => (SampleType::U32, DataKind::Continuous),
            options if options.overlaps.is_computed() => (SampleType::F64, DataKind::Continuous),
            RasterizeOptions { value: FeatureValue::Number(number), .. } => match number.to_integer() {
                Some(number) => (of_range([number; 2]), DataKind::Categorical),
                None => {
                    let is_single = f64::from(number.to_f64() as f32) == number.to_f64();
                    (if is_single { SampleType::F32 } else { SampleType::F64 }, DataKind::Continuous)
                }
            },
            _ if !self.strings.is_empty() => {
                (of_range([0, self.strings.len() as i128]), DataKind::Categorical)
            }
            _ if self.has_reals => (SampleType::F64, DataKind::Continuous),
            _ if self.has_booleans && !self.has_integers => (SampleType::U8, DataKind::Categorical),
            _ => {
                let wide = [SampleType::I32, SampleType::I64, SampleType::U64];
                let sample = wide.into_iter().find(|sample| self.unfit(*sample, None).is_none());
                (sample.unwrap_or(SampleType::F64), DataKind::Continuous)
            }
        };
        (ValueType::new(options.sample.unwrap_or(sample), 1), options.kind.unwrap_or(kind))
    }
}

/// Converts an integer to a number.
fn number_of(whole: i128) -> Number {
    u64::try_from(whole)
        .map(Number::from)
        .or_else(|_| i64::try_from(whole).map(Number::from))
        .unwrap_or_else(|_| (whole as f64).into())
}

/// Maximum number of class names in an error message.
const MAX_REMEMBERED: usize = 20;

fn unknown_class(text: &str, classes: &BTreeMap<Number, String>) -> Error {
    let mut known: Vec<&str> = classes.values().take(MAX_REMEMBERED).map(String::as_str).collect();
    if classes.len() > MAX_REMEMBERED {
        known.push("...");
    }
    let expected = match &known[..] {
        [] => "numbers: the tree's classes have no names".into(),
        known => format!("names of the tree's classes: {}", known.join(", ")),
    };
    Error::invalid("value", format!("`{text}`"), expected)
}

/// Returns the smallest integer type for a range.
fn of_range([low, high]: [i128; 2]) -> SampleType {
    use SampleType::{I8, I16, I32, I64, U8, U16, U32, U64};
    let types = if low < 0 { [I8, I16, I32, I64] } else { [U8, U16, U32, U64] };
    let signs = i128::from(low < 0);
    let fits = |bits: i128| low >= -(1 << (bits - 1)) * signs && high < 1 << (bits - signs);
    [8, 16, 32].iter().position(|bits| fits(*bits)).map_or(types[3], |index| types[index])
}

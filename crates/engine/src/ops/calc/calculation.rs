//! Calculations as operations of views: `calc=(b2-b1)/(b2+b1),type=f32`,
//! `reduce=median,a=x.goblin`, `composite=B08,B04,B03`.

use std::fmt;
use std::path::{Path, PathBuf};

use super::expression::{Expression, Name, Reducer};
use super::parse::{parse, quoted};
use super::source::Calculated;
use crate::ops::affine::View;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};

/// Calculation with the cells of a tree, and of files that are aligned with its grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Calculation {
    pub(super) formula: Formula,
    /// Files with their names in the expression.
    pub(super) files: Vec<(String, PathBuf)>,
    /// Sample type of the result; f32 by default.
    pub(super) sample: Option<SampleType>,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Formula {
    /// Expression and its source string.
    Expression { expression: Expression, text: String },
    /// One number from all channels of all layers and files.
    Reduction(Reducer),
    /// A channel of each of several layers, unchanged.
    Composite(Vec<Name>),
}

/// Maximum number of channels.
const MAX_CHANNELS: usize = 4;

impl Calculation {
    /// Parses an expression with its options: the string after `calc=`.
    ///
    /// # Errors
    /// If it is invalid.
    pub fn parse(text: &str) -> Result<Calculation> {
        let (expression, rest) = split_expression(text)?;
        let formula = Formula::Expression { expression: parse(expression)?, text: expression.trim().into() };
        Calculation::with_options(formula, rest)
    }

    /// Parses a reduction with its options: the string after `reduce=`.
    ///
    /// # Errors
    /// If it is invalid.
    pub fn parse_reduction(text: &str) -> Result<Calculation> {
        let (name, rest) = text.split_once(',').map_or((text, None), |(name, rest)| (name, Some(rest)));
        let names = Reducer::ALL.map(Reducer::name).join(", ");
        let reducer = Reducer::named(name.trim());
        let reducer = reducer.ok_or_else(|| Error::invalid("reduce", format!("`{name}`"), names))?;
        Calculation::with_options(Formula::Reduction(reducer), rest)
    }

    /// Composite of the layers or channels with these names, as channels of one tree in this order.
    ///
    /// # Errors
    /// If there are not two to four names.
    pub fn composite(names: &[String]) -> Result<Calculation> {
        if !(2..=MAX_CHANNELS).contains(&names.len()) {
            let found = format!("{} layers", names.len());
            return Err(Error::invalid("composite", found, "2 to 4 layers, for example red, green and blue"));
        }
        let name = |name: &String| Name { whole: name.clone(), channel: None };
        let formula = Formula::Composite(names.iter().map(name).collect());
        Ok(Calculation { formula, files: Vec::new(), sample: None })
    }

    /// Parses names separated by commas: the string after `composite=`. Names with commas are
    /// quoted.
    ///
    /// # Errors
    /// If there are not two to four names.
    pub(in crate::ops) fn parse_composite(text: &str) -> Result<Calculation> {
        let (mut names, mut rest) = (Vec::new(), Some(text));
        while let Some(text) = rest {
            let expected = "2 to 4 names of layers or channels, separated by commas";
            let wrong = || Error::invalid("composite", format!("`{text}`"), expected);
            let (name, following) = argument(text).ok_or_else(wrong)?;
            let name = if text.starts_with(['"', '\'']) { name } else { name.trim().into() };
            if name.is_empty() {
                return Err(wrong());
            }
            names.push(name);
            rest = following;
        }
        Calculation::composite(&names)
    }

    /// Whether channels are copied unchanged.
    pub(super) fn is_composite(&self) -> bool {
        matches!(self.formula, Formula::Composite(_))
    }

    fn with_options(formula: Formula, rest: Option<&str>) -> Result<Calculation> {
        let mut calculation = Calculation { formula, files: Vec::new(), sample: None };
        let mut rest = rest;
        while let Some(text) = rest {
            let wrong = |expected: &str| {
                Error::invalid("calculation", format!("`{text}` after the expression"), expected)
            };
            let expected = "NAME=FILE, or type=u8, u16, i16, u32, i32, f32 or f64";
            let (name, more) = text.split_once('=').ok_or_else(|| wrong(expected))?;
            let (value, following) =
                argument(more).ok_or_else(|| wrong("a file name in quotation marks, then a comma"))?;
            let name = name.trim();
            if name == "type" {
                let sample = SampleType::ALL.into_iter().find(|sample| sample.name() == value);
                calculation.sample = Some(sample.ok_or_else(|| wrong(expected))?);
            } else if !is_name(name) || value.is_empty() {
                return Err(wrong(expected));
            } else if calculation.files.iter().any(|(other, _)| other == name) {
                return Err(wrong("a different name for each file"));
            } else {
                calculation.files.push((name.into(), value.into()));
            }
            rest = following;
        }
        Ok(calculation)
    }

    /// Files that are read in addition to the tree that it is applied to.
    pub fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.files.iter().map(|(_, path)| path)
    }

    /// The calculation with other names of its files.
    pub(in crate::ops) fn with_files(&self, name: &dyn Fn(&Path) -> Result<PathBuf>) -> Result<Calculation> {
        let file = |(own, path): &(String, PathBuf)| Ok((own.clone(), name(path)?));
        Ok(Calculation { files: self.files.iter().map(file).collect::<Result<_>>()?, ..self.clone() })
    }

    /// View of the results, computed from a view and the files.
    ///
    /// # Errors
    /// If a name cannot be resolved, or a file cannot be read or aligned.
    pub(in crate::ops) fn apply(&self, view: View) -> Result<View> {
        View::of_made(Calculated::new(self, &view)?.into(), &view)
    }
}

/// Splits a string into the expression, which may be in single quotes, up to the first comma
/// outside of parentheses; and the rest after that comma.
fn split_expression(text: &str) -> Result<(&str, Option<&str>)> {
    if let Some(rest) = text.strip_prefix('\'') {
        let wrong = |found: &str| {
            Error::invalid("calculation", found, "an expression in single quotes, then a comma")
        };
        let (expression, following) =
            rest.split_once('\'').ok_or_else(|| wrong("a ' without a closing '"))?;
        let more = following.strip_prefix(',');
        let is_end = following.is_empty() || more.is_some();
        return is_end.then_some((expression, more)).ok_or_else(|| wrong(following));
    }
    let (mut depth, mut at) = (0usize, 0);
    let bytes = text.as_bytes();
    while at < bytes.len() {
        match bytes[at] {
            b'(' => depth += 1,
            b')' => depth = depth.saturating_sub(1),
            b',' if depth == 0 => return Ok((&text[..at], Some(&text[at + 1..]))),
            // (The parser reports an unterminated one.)
            b'"' => at += quoted(&text[at..]).map_or(bytes.len(), |(length, _)| length) - 1,
            _ => {}
        }
        at += 1;
    }
    Ok((text, None))
}

/// The string before the first comma, or in quotes, and the rest after the comma.
fn argument(text: &str) -> Option<(String, Option<&str>)> {
    if text.starts_with(['"', '\'']) {
        let (length, value) = quoted(text)?;
        let following = &text[length..];
        let more = following.strip_prefix(',');
        return (following.is_empty() || more.is_some()).then_some((value, more));
    }
    Some(text.split_once(',').map_or((text.into(), None), |(value, rest)| (value.into(), Some(rest))))
}

/// Whether a string is a name that needs no quotes in expressions.
fn is_name(text: &str) -> bool {
    text.starts_with(|first: char| first.is_alphabetic() || first == '_')
        && text.chars().all(|character| character.is_alphanumeric() || character == '_')
        && !["and", "or", "not"].contains(&text)
}

/// An argument, quoted if it would be parsed differently otherwise.
fn written(argument: &str) -> String {
    let is_plain =
        !argument.contains(',') && !argument.starts_with(['"', '\'']) && argument.trim() == argument;
    if is_plain { argument.into() } else { format!("\"{}\"", argument.replace('"', "\"\"")) }
}

/// Writes the operation; parsing it gives the same calculation.
impl fmt::Display for Calculation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.formula {
            Formula::Expression { text, .. } => write!(f, "calc={text}")?,
            Formula::Reduction(reducer) => write!(f, "reduce={}", reducer.name())?,
            Formula::Composite(names) => {
                let names: Vec<String> = names.iter().map(|name| written(&name.whole)).collect();
                write!(f, "composite={}", names.join(","))?;
            }
        }
        for (name, path) in &self.files {
            write!(f, ",{name}={}", written(&path.display().to_string()))?;
        }
        self.sample.map_or(Ok(()), |sample| write!(f, ",type={}", sample.name()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_read_as_they_are_written() {
        for (text, usual) in [
            ("'(b2-b1)/(b2+b1)'", "calc=(b2-b1)/(b2+b1)"),
            (" where(a>1,a,0) ,a=x.goblin,type=u8", "calc=where(a>1,a,0),a=x.goblin,type=u8"),
            (
                "'a*\"b,c\"',type=f64,a=\"x, \"\"y\"\".goblin\"",
                "calc=a*\"b,c\",a=\"x, \"\"y\"\".goblin\",type=f64",
            ),
            ("a,a='it''s, x'", "calc=a,a=\"it's, x\""),
        ] {
            let calculation = Calculation::parse(text).unwrap();
            assert_eq!(calculation.to_string(), usual);
            assert_eq!(Calculation::parse(usual.strip_prefix("calc=").unwrap()).unwrap(), calculation);
        }
        let median = Calculation::parse_reduction("median,type=u16").unwrap();
        assert_eq!(median.to_string(), "reduce=median,type=u16");
    }

    #[test]
    fn composites_are_two_to_four_names() {
        for (text, usual) in [
            ("B08, B04,B03", "composite=B08,B04,B03"),
            ("\"July, late\",a \"b\"", "composite=\"July, late\",a \"b\""),
            ("'it''s',\"\"\"x\"\"\",b1,b2", "composite=it's,\"\"\"x\"\"\",b1,b2"),
        ] {
            let composite = Calculation::parse_composite(text).unwrap();
            assert_eq!(composite.to_string(), usual);
            let again = usual.strip_prefix("composite=").unwrap();
            assert_eq!(Calculation::parse_composite(again).unwrap(), composite);
        }
        for wrong in ["", "a", "a,,b", "a,b,", "a,b,c,d,e", "\"a,b", "\"a\"b,c"] {
            assert!(Calculation::parse_composite(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn options_after_an_expression_are_checked() {
        for (text, expected) in [
            ("a,b", "NAME=FILE"),
            ("a,type=u7", "type=u8"),
            ("a,a=", "NAME=FILE"),
            ("a,a=x,a=y", "a different name"),
            ("a,1=x", "NAME=FILE"),
            ("a,a=\"x", "in quotation marks"),
            ("'a", "in single quotes"),
            ("'a'b", "in single quotes"),
        ] {
            let error = Calculation::parse(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
        assert!(Calculation::parse_reduction("sum").unwrap_err().to_string().contains("median, mean"));
    }
}

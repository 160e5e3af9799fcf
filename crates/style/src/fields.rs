//! Typed access to the members of JSON objects in a style document.

use std::ops::RangeInclusive;

use serde_json::{Map, Value};

use super::colour;
use spinney_base::{Error, Result};

/// An object of a document.
pub(super) struct Fields<'a> {
    /// Location of the object in the document, for messages.
    place: String,
    members: &'a Map<String, Value>,
    /// Names of the members that were requested.
    known: Vec<&'static str>,
}

/// Creates an error about a value at a location in the document.
pub(super) fn wrong(place: &str, found: &Value, expected: impl Into<String>) -> Error {
    Error::invalid(place, shortened(found.to_string()), expected)
}

/// Truncates a string to 60 characters.
pub(super) fn shortened(mut text: String) -> String {
    if let Some((end, _)) = text.char_indices().nth(60) {
        text.truncate(end);
        text.push_str("...");
    }
    text
}

impl<'a> Fields<'a> {
    /// Wraps a JSON object.
    ///
    /// # Errors
    /// If the value is not an object.
    pub(super) fn of(place: String, value: &'a Value) -> Result<Fields<'a>> {
        match value {
            Value::Object(members) => Ok(Fields { place, members, known: Vec::new() }),
            other => Err(wrong(&place, other, "an object, as in {\"draw\": \"hillshade\"}")),
        }
    }

    /// Location of a member in the document.
    pub(super) fn place(&self, name: &str) -> String {
        if self.place.is_empty() { format!("style: {name}") } else { format!("{}.{name}", self.place) }
    }

    /// Returns a member; null counts as missing.
    pub(super) fn value(&mut self, name: &'static str) -> Option<&'a Value> {
        self.known.push(name);
        self.members.get(name).filter(|value| !value.is_null())
    }

    /// A number within a range.
    pub(super) fn number(&mut self, name: &'static str, range: RangeInclusive<f64>) -> Result<Option<f64>> {
        let Some(value) = self.value(name) else { return Ok(None) };
        match value.as_f64().filter(|number| range.contains(number)) {
            Some(number) => Ok(Some(number)),
            None => {
                let (low, high) = (range.start(), range.end());
                let expected = match (*low == f64::MIN, *high == f64::MAX) {
                    (true, _) => "a number".into(),
                    (_, true) => format!("a number, at least {low}"),
                    _ => format!("a number, {low} to {high}"),
                };
                Err(wrong(&self.place(name), value, expected))
            }
        }
    }

    /// An integer within a range.
    pub(super) fn integer(&mut self, name: &'static str, range: RangeInclusive<u64>) -> Result<Option<u64>> {
        let Some(value) = self.value(name) else { return Ok(None) };
        match value.as_u64().filter(|number| range.contains(number)) {
            Some(number) => Ok(Some(number)),
            None => {
                let expected = format!("an integer, {} to {}", range.start(), range.end());
                Err(wrong(&self.place(name), value, expected))
            }
        }
    }

    /// A string.
    pub(super) fn text(&mut self, name: &'static str) -> Result<Option<&'a str>> {
        let Some(value) = self.value(name) else { return Ok(None) };
        value.as_str().map(Some).ok_or_else(|| wrong(&self.place(name), value, "a string"))
    }

    /// One of several keywords.
    pub(super) fn choice<T: Copy>(
        &mut self,
        name: &'static str,
        choices: &[(&'static str, T)],
    ) -> Result<Option<T>> {
        let Some(value) = self.value(name) else { return Ok(None) };
        let chosen = choices.iter().find(|(word, _)| value.as_str() == Some(word));
        let names = || choices.iter().map(|(word, _)| *word).collect::<Vec<_>>().join(", ");
        chosen.map(|(_, choice)| Some(*choice)).ok_or_else(|| wrong(&self.place(name), value, names()))
    }

    /// A colour.
    pub(super) fn colour(&mut self, name: &'static str) -> Result<Option<[u8; 4]>> {
        self.value(name).map(|value| colour_of(&self.place(name), value)).transpose()
    }

    /// A list of at most `most` entries.
    pub(super) fn list(&mut self, name: &'static str, most: usize) -> Result<Option<&'a [Value]>> {
        self.value(name).map(|value| list_of(&self.place(name), value, most)).transpose()
    }

    /// Returns an error if there is a member that was not requested.
    pub(super) fn finish(self) -> Result<()> {
        match self.members.keys().find(|name| !self.known.contains(&name.as_str())) {
            None => Ok(()),
            Some(other) => {
                let place = if self.place.is_empty() { "style" } else { &self.place };
                let found = format!("`{}`", shortened(other.clone()));
                Err(Error::invalid(place, found, format!("one of {}", self.known.join(", "))))
            }
        }
    }
}

/// Parses a colour. `place` is its location, for messages.
pub(super) fn colour_of(place: &str, value: &Value) -> Result<[u8; 4]> {
    let read = value.as_str().and_then(colour::parse);
    read.ok_or_else(|| wrong(place, value, "a colour, as in \"#ff8800\" (or with opacity, \"#ff880080\")"))
}

/// Checks that a value is a list of at most `most` entries. `place` is its location, for messages.
pub(super) fn list_of<'a>(place: &str, value: &'a Value, most: usize) -> Result<&'a [Value]> {
    match value.as_array() {
        Some(list) if list.len() <= most => Ok(list),
        Some(list) => {
            Err(Error::invalid(place, format!("{} entries", list.len()), format!("at most {most}")))
        }
        None => Err(wrong(place, value, "a list")),
    }
}

//! Attributes of parts, stored as the JSON of the source file.

use std::collections::{BTreeMap, HashSet};
use std::fmt;
use std::path::Path;

use serde::de::{self, Deserializer as _, MapAccess, Visitor};
use serde_json::value::RawValue;
use spinney_base::Error;

/// Maximum number of distinct members of an object; members of nested objects are not counted.
const MAX_MEMBERS: usize = 1 << 16;

/// Attributes of a model's parts, and metadata of its source files.
///
/// Each entry is a JSON object without white space between tokens; numbers and strings are
/// unchanged. A part's entry has the members of a CityJSON city object except its geometry: `type`,
/// `attributes`, `parents` and so on. A file's entry has its `metadata`, except extents and
/// reference system, and its `extensions`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Attributes {
    parts: BTreeMap<u32, String>,
    files: Vec<String>,
    bytes: u64,
    limit: u64,
}

impl Attributes {
    /// Creates an empty collection that holds at most `limit` bytes.
    pub fn within(limit: u64) -> Attributes {
        Attributes { limit, ..Attributes::default() }
    }

    /// Returns the JSON of a part, if it has any.
    pub fn part(&self, part: u32) -> Option<&str> {
        self.parts.get(&part).map(String::as_str)
    }

    /// Returns the number of parts with attributes.
    pub fn parts(&self) -> u64 {
        self.parts.len() as u64
    }

    /// Returns the JSON of the source files that have metadata.
    pub fn files(&self) -> &[String] {
        &self.files
    }

    /// Reserves memory for an entry, or fails if the limit is exceeded; `path` is for the error.
    fn reserve(&mut self, path: &Path, bytes: usize) -> spinney_base::Result<()> {
        // (48 bytes for the containers' overhead.)
        self.bytes += bytes as u64 + 48;
        if self.bytes <= self.limit {
            return Ok(());
        }
        Err(Error::TooLarge {
            path: path.to_path_buf(),
            what: "storing the attributes of objects".into(),
            needed: self.bytes,
            limit: self.limit,
            advice: "allow more memory, or split the file".into(),
        })
    }

    /// Adds the JSON of a part.
    ///
    /// # Errors
    /// If the memory limit is exceeded; the error names `path`.
    pub fn push_part(&mut self, path: &Path, part: u32, text: String) -> spinney_base::Result<()> {
        self.reserve(path, text.len())?;
        self.parts.insert(part, text);
        Ok(())
    }

    /// Adds the JSON of a file.
    ///
    /// # Errors
    /// If the memory limit is exceeded; the error names `path`.
    pub fn push_file(&mut self, path: &Path, text: String) -> spinney_base::Result<()> {
        self.reserve(path, text.len())?;
        self.files.push(text);
        Ok(())
    }
}

/// Visits the members of a JSON object with their JSON values. Of members with equal keys, the
/// first counts.
///
/// # Errors
/// If `json` is not a JSON object, or has more than 65536 members.
pub fn each_member<'a>(json: &'a str, each: impl FnMut(&str, &'a str)) -> serde_json::Result<()> {
    struct Members<F> {
        each: F,
    }

    impl<'de, F: FnMut(&str, &'de str)> Visitor<'de> for Members<F> {
        type Value = ();

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a JSON object")
        }

        fn visit_map<A: MapAccess<'de>>(mut self, mut map: A) -> Result<(), A::Error> {
            let mut taken = HashSet::new();
            while let Some((key, value)) = map.next_entry::<String, &'de RawValue>()? {
                if taken.contains(&key) {
                    continue;
                }
                if taken.len() == MAX_MEMBERS {
                    return Err(de::Error::custom("an object with more than 65536 members"));
                }
                (self.each)(&key, value.get());
                taken.insert(key);
            }
            Ok(())
        }
    }

    let mut json = serde_json::Deserializer::from_str(json);
    json.deserialize_map(Members { each })?;
    json.end()
}

/// Returns a part's JSON with the points in its address locations replaced. `map` returns the new
/// JSON of each point list (`address[].location.boundaries`), or `None` to remove the location.
///
/// In a model's attributes, these lists have world coordinates, `[[x,y,z],...]`. (In CityJSON
/// files, they have vertex indices.)
///
/// # Errors
/// If `about` is not a JSON object.
pub fn map_locations(about: &str, map: &mut LocationMap<'_>) -> serde_json::Result<String> {
    with_member(about, "address", &mut |addresses| {
        if addresses.starts_with('{') {
            return with_location(addresses, map).map(Some);
        }
        if !addresses.starts_with('[') {
            return Ok(Some(addresses.into()));
        }
        let addresses: Vec<&RawValue> = serde_json::from_str(addresses)?;
        let mapped = addresses.iter().map(|address| match address.get() {
            object if object.starts_with('{') => with_location(object, map),
            other => Ok(other.into()),
        });
        Ok(Some(format!("[{}]", mapped.collect::<serde_json::Result<Vec<_>>>()?.join(","))))
    })
}

/// Returns the new JSON of a point list.
type LocationMap<'a> = dyn FnMut(&str) -> Option<String> + 'a;

/// Replaces an address's location.
fn with_location(address: &str, map: &mut LocationMap<'_>) -> serde_json::Result<String> {
    with_member(address, "location", &mut |location| {
        if !location.starts_with('{') {
            return Ok(Some(location.into()));
        }
        let mut has_points = false;
        let mapped = with_member(location, "boundaries", &mut |boundaries| {
            let mapped = map(boundaries);
            has_points = mapped.is_some();
            Ok(mapped)
        })?;
        Ok(has_points.then_some(mapped))
    })
}

/// Returns the new JSON of a member, or `None` to remove it.
pub(crate) type MemberMap<'a> = dyn FnMut(&str) -> serde_json::Result<Option<String>> + 'a;

/// Returns a JSON object in which the member `name` is replaced.
pub(crate) fn with_member(object: &str, name: &str, map: &mut MemberMap<'_>) -> serde_json::Result<String> {
    let mut text = ObjectText::default();
    let mut failure = None;
    each_member(object, |key, value| {
        if key != name {
            return text.push(key, value);
        }
        match map(value) {
            Ok(Some(mapped)) => text.push(key, &mapped),
            Ok(None) => {}
            Err(error) => failure = Some(error),
        }
    })?;
    failure.map_or(Ok(text.to_string()), Err)
}

/// A JSON object that is built member by member, without white space between tokens.
#[derive(Default)]
pub struct ObjectText {
    text: String,
}

impl ObjectText {
    /// Adds a member whose value is JSON.
    pub fn push(&mut self, key: &str, json: &str) {
        self.text.push(if self.text.is_empty() { '{' } else { ',' });
        self.text.push_str(&serde_json::Value::from(key).to_string());
        self.text.push(':');
        let (mut in_text, mut is_escaped) = (false, false);
        for character in json.chars() {
            if in_text || !character.is_ascii_whitespace() {
                self.text.push(character);
            }
            in_text ^= character == '"' && !is_escaped;
            is_escaped = in_text && character == '\\' && !is_escaped;
        }
    }

    /// Returns whether it has no members.
    pub fn is_empty(&self) -> bool {
        self.text.is_empty()
    }
}

impl fmt::Display for ObjectText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let end = if self.is_empty() { "{}" } else { "}" };
        write!(f, "{}{end}", self.text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn compact(json: &str, without: &str) -> ObjectText {
        let mut text = ObjectText::default();
        each_member(json, |key, value| {
            if key != without {
                text.push(key, value);
            }
        })
        .unwrap();
        text
    }

    #[test]
    fn objects_lose_white_space_and_nothing_else() {
        let json = " { \"a \\\" b\" : [ 1.10 , 1e400, { \"x\" : \" \\\\\" } ] , \"no\":1,\n\"\u{e9}\":\" \\\" \", \"no\": 2, \"\u{e9}\": 3 } ";
        let expected = "{\"a \\\" b\":[1.10,1e400,{\"x\":\" \\\\\"}],\"\u{e9}\":\" \\\" \"}";
        assert_eq!(compact(json, "no").to_string(), expected);
        assert_eq!(compact(expected, "").to_string(), expected);
        assert_eq!(compact("{ }", "").to_string(), "{}");
        for wrong in ["", "[]", "1", "{\"a\":}", "{} {}"] {
            assert!(each_member(wrong, |_, _| ()).is_err(), "{wrong}");
        }
    }

    #[test]
    fn locations_are_mapped() {
        let text = "{\"type\":\"Building\",\"address\":[{\"a\":1.10,\"location\":{\"type\":\"MultiPoint\",\"boundaries\":[7]}},3,{\"b\":[]}]}";
        let mapped = |text: &str, to: Option<&str>| {
            map_locations(text, &mut |points| {
                assert_eq!(points, "[7]");
                to.map(String::from)
            })
        };
        assert_eq!(mapped(text, Some("[[1,2,3]]")).unwrap(), text.replace("[7]", "[[1,2,3]]"));
        let without = text.replace(",\"location\":{\"type\":\"MultiPoint\",\"boundaries\":[7]}", "");
        assert_eq!(mapped(text, None).unwrap(), without);
        assert_eq!(mapped(&without, None).unwrap(), without);
        let single = "{\"address\":{\"location\":{\"boundaries\":[7]}}}";
        assert_eq!(mapped(single, Some("[]")).unwrap(), single.replace("[7]", "[]"));
        for same in ["{}", "{\"address\":null}", "{\"address\":[{\"location\":null}]}"] {
            assert_eq!(mapped(same, None).unwrap(), same);
        }
        assert!(mapped("{\"address\":[}", None).is_err());
    }

    #[test]
    fn members_are_counted() {
        let object = |count: usize| {
            let members: Vec<String> = (0..count).map(|i| format!("\"{i}\":{i}")).collect();
            format!("{{{}}}", members.join(","))
        };
        let mut count = 0;
        each_member(&object(MAX_MEMBERS), |_, _| count += 1).unwrap();
        assert_eq!(count, MAX_MEMBERS);
        assert!(each_member(&object(MAX_MEMBERS + 1), |_, _| ()).is_err());
    }

    #[test]
    fn attributes_beyond_the_limit_are_rejected() {
        let path = Path::new("a.json");
        let mut attributes = Attributes::within(200);
        attributes.push_file(path, "{\"metadata\":{}}".into()).unwrap();
        attributes.push_part(path, 3, "{\"a\":1}".into()).unwrap();
        let error = attributes.push_part(path, 4, "x".repeat(100)).unwrap_err();
        assert!(matches!(error, Error::TooLarge { limit: 200, .. }), "{error}");
        assert_eq!(
            (attributes.parts(), attributes.files().len(), attributes.part(3)),
            (1, 1, Some("{\"a\":1}"))
        );
    }
}

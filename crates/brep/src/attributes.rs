//! Attributes of parts, as JSON that is kept as it was written: in the metadata of a file as tags of a domain of their own.

use std::collections::{BTreeMap, HashSet};
use std::fmt;

use serde::de::{Deserializer as _, Error as _, MapAccess, Visitor};
use serde_json::value::RawValue;

/// Most members of an object whose members are told apart (those within them are not counted).
const MOST_MEMBERS: usize = 1 << 16;

/// The domain of the tags.
pub const DOMAIN: &str = "cityjson";

/// Attributes of the parts of a model, and what is said of the files that it is of.
///
/// Each text is a JSON object, without white space between its tokens, numbers and texts in it as they were written. That
/// of a part has what CityJSON says of a city object, but for its geometry: `type`, `attributes`, `parents` and so
/// on. That of a file has its `metadata`, but for extents and the reference system, and its `extensions`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Attributes {
    parts: BTreeMap<u32, String>,
    files: Vec<String>,
    bytes: usize,
    lost: u64,
}

impl Attributes {
    /// Most bytes of all texts together: they are held in memory, and the metadata of a file have at most 16 MiB.
    pub const MOST_BYTES: usize = 12 << 20;

    /// Bytes that a text counts more than it has, for its key.
    const EACH: usize = 24;

    /// Bytes of metadata that are left for other things.
    const OTHERS: usize = 3 << 20;

    /// None yet, that are to stand beside so many bytes of names: these take some of their room if they are very long.
    pub fn beside(bytes: usize) -> Attributes {
        Attributes { bytes: bytes.saturating_sub(Self::OTHERS), ..Attributes::default() }
    }

    /// The text about a part, if there is one.
    pub fn part(&self, part: u32) -> Option<&str> {
        self.parts.get(&part).map(String::as_str)
    }

    /// The texts about parts with their numbers.
    pub fn parts(&self) -> impl Iterator<Item = (u32, &str)> {
        self.parts.iter().map(|(part, text)| (*part, text.as_str()))
    }

    /// The texts about files, of those that say anything of themselves.
    pub fn files(&self) -> &[String] {
        &self.files
    }

    /// Number of texts that there was no room for.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Whether there is nothing.
    pub fn is_empty(&self) -> bool {
        self.parts.is_empty() && self.files.is_empty()
    }

    fn take_room(&mut self, bytes: usize) -> bool {
        let all = self.bytes.saturating_add(bytes).saturating_add(Self::EACH);
        let fits = all <= Self::MOST_BYTES;
        if fits {
            self.bytes = all;
        } else {
            self.lost += 1;
        }
        fits
    }

    /// Adds what is said of a part.
    pub fn push_part(&mut self, part: u32, text: &ObjectText) {
        if self.take_room(text.len()) {
            self.parts.insert(part, text.to_string());
        }
    }

    /// Adds what is said of a file.
    pub fn push_file(&mut self, text: &ObjectText) {
        if self.take_room(text.len()) {
            self.files.push(text.to_string());
        }
    }

    /// Takes those of another model, whose `count` parts come behind `first` others.
    pub fn append(&mut self, other: &Attributes, first: u32, count: u32) {
        self.lost += other.lost;
        for text in &other.files {
            if self.take_room(text.len()) {
                self.files.push(text.clone());
            }
        }
        for (part, text) in other.parts().filter(|(part, _)| *part < count) {
            if self.take_room(text.len()) {
                self.parts.insert(first.saturating_add(part), text.into());
            }
        }
    }

    /// The tags of a file's metadata.
    pub fn to_tags(&self) -> BTreeMap<String, String> {
        let files = self.files.iter().enumerate().map(|(i, text)| (format!("file {i}"), text.clone()));
        files.chain(self.parts().map(|(part, text)| (format!("part {part}"), text.into()))).collect()
    }

    /// Attributes in tags; those that are none of ours are passed over.
    pub fn from_tags(tags: &BTreeMap<String, String>) -> Attributes {
        let mut attributes = Attributes::default();
        let mut files = BTreeMap::new();
        for (key, text) in tags {
            let Some((what, Ok(number))) = key.split_once(' ').map(|(what, n)| (what, n.parse::<u32>()))
            else {
                continue;
            };
            match what {
                "part" => _ = attributes.parts.insert(number, text.clone()),
                "file" => _ = files.insert(number, text),
                _ => {}
            }
        }
        attributes.files = files.into_values().cloned().collect();
        // What is in a file has had room there.
        attributes.bytes = tags.values().map(|text| text.len() + Self::EACH).sum();
        attributes
    }
}

/// Goes through the members of a JSON object, each with its text. Of those with the same key, the first counts.
///
/// # Errors
/// If it is no JSON, no object, or has more than 65536 members.
pub fn each_member<'a>(json: &'a str, each: impl FnMut(&str, &'a str)) -> serde_json::Result<()> {
    struct Members<F> {
        each: F,
    }

    impl<'de, F: FnMut(&str, &'de str)> Visitor<'de> for Members<F> {
        type Value = ();

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("an object")
        }

        fn visit_map<A: MapAccess<'de>>(mut self, mut map: A) -> Result<(), A::Error> {
            let mut taken = HashSet::new();
            while let Some((key, value)) = map.next_entry::<String, &'de RawValue>()? {
                if taken.contains(&key) {
                    continue;
                }
                if taken.len() == MOST_MEMBERS {
                    return Err(A::Error::custom("more than 65536 members of an object"));
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

/// A JSON object that is put together member by member, with nothing between tokens; no more of it than [`Attributes`] have
/// room for.
#[derive(Default)]
pub struct ObjectText {
    text: String,
}

impl ObjectText {
    /// Adds an attribute, whose value is JSON.
    pub fn push(&mut self, key: &str, json: &str) {
        self.text.push(if self.text.is_empty() { '{' } else { ',' });
        self.text.push_str(&serde_json::Value::from(key).to_string());
        self.text.push(':');
        let (mut in_text, mut is_escaped) = (false, false);
        for character in json.chars() {
            if self.text.len() > Attributes::MOST_BYTES {
                return;
            }
            if in_text || !character.is_ascii_whitespace() {
                self.text.push(character);
            }
            in_text ^= character == '"' && !is_escaped;
            is_escaped = in_text && character == '\\' && !is_escaped;
        }
    }

    /// Whether it has no members.
    pub fn is_empty(&self) -> bool {
        self.text.is_empty()
    }

    /// Bytes of the text; more than there is room for if it was too long.
    fn len(&self) -> usize {
        self.text.len() + 2
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
    fn members_are_counted() {
        let object = |count: usize| {
            let members: Vec<String> = (0..count).map(|i| format!("\"{i}\":{i}")).collect();
            format!("{{{}}}", members.join(","))
        };
        let mut count = 0;
        each_member(&object(MOST_MEMBERS), |_, _| count += 1).unwrap();
        assert_eq!(count, MOST_MEMBERS);
        assert!(each_member(&object(MOST_MEMBERS + 1), |_, _| ()).is_err());
    }

    #[test]
    fn what_does_not_fit_is_counted() {
        let long = format!("{{\"a\":\"{}\"}}", "x".repeat(Attributes::MOST_BYTES / 2));
        let mut attributes = Attributes::default();
        attributes.push_file(&compact("{\"metadata\":{}}", ""));
        for part in 0..4 {
            attributes.push_part(part, &compact(if part == 2 { "{\"a\":1}" } else { &long }, ""));
        }
        assert_eq!(attributes.parts().map(|(part, _)| part).collect::<Vec<_>>(), [0, 2]);
        assert_eq!(attributes.lost(), 2);
        let read = Attributes::from_tags(&attributes.to_tags());
        assert_eq!((read.files(), &read.parts), (attributes.files(), &attributes.parts));
        let mut both = Attributes::default();
        both.append(&attributes, 10, 3);
        both.append(&attributes, 20, 9);
        assert_eq!(both.parts().map(|(part, _)| part).collect::<Vec<_>>(), [10, 12, 22]);
        assert_eq!((both.files().len(), both.lost()), (2, 5));
    }
}

//! Semantics of the surfaces of CityJSON geometries, which become face values.

use std::fmt;

use super::face_values::MAX_VALUE_BYTES;
use serde::de::{self, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::value::RawValue;
use spinney_brep::attributes::{ObjectText, each_member};

/// Column of the semantic surface's number in its object. Several faces may share a surface.
pub(crate) const SURFACE: &str = "surface";
/// Column of the surface type: "RoofSurface".
pub(crate) const TYPE: &str = "type";
/// Column of the parent surface's number: a window's wall, for example.
pub(crate) const PARENT: &str = "parent";
/// Column of the other attributes of the surface: a JSON object.
pub(crate) const ATTRIBUTES: &str = "attributes";

/// Member of a part's attributes with the level of detail of its geometry, unless that is 2.
pub(crate) const LOD: &str = "lod";

/// Maximum number of surfaces with semantics in a geometry. A few bytes of a file become a hundred
/// bytes in memory.
const MAX_SURFACES: usize = 1 << 20;

/// Semantics of a geometry's surfaces. The nested lists of semantics numbers are parsed in step
/// with the lists of boundaries, without building them in memory.
pub(super) struct Semantics<'a> {
    surfaces: Vec<Surface>,
    /// Unread rest of the nested lists.
    rest: &'a [u8],
    /// Depth of boundary lists below a list that has no numbers; 0 inside of lists with numbers.
    missing: u32,
    lost: u64,
}

/// Semantic surface: the values of its faces.
#[derive(Default)]
struct Surface {
    number: String,
    kind: Option<String>,
    parent: Option<String>,
    attributes: Option<String>,
    has_faces: bool,
}

#[derive(Deserialize)]
struct Document<'a> {
    #[serde(borrow, default)]
    surfaces: SurfaceList<'a>,
    #[serde(borrow)]
    values: Option<&'a RawValue>,
}

/// JSON of each surface.
#[derive(Default)]
struct SurfaceList<'a>(Vec<&'a RawValue>);

impl<'de: 'a, 'a> Deserialize<'de> for SurfaceList<'a> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Few;

        impl<'de> Visitor<'de> for Few {
            type Value = SurfaceList<'de>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a list of surfaces")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<SurfaceList<'de>, A::Error> {
                let mut surfaces = Vec::new();
                while let Some(surface) = list.next_element()? {
                    if surfaces.len() == MAX_SURFACES {
                        return Err(de::Error::custom("more than 2^20 surfaces"));
                    }
                    surfaces.push(surface);
                }
                Ok(SurfaceList(surfaces))
            }
        }

        deserializer.deserialize_seq(Few)
    }
}

impl<'a> Semantics<'a> {
    /// Parses semantics from JSON, if any. Surfaces are numbered from `first` on.
    pub(super) fn of(text: Option<&'a RawValue>, first: u64) -> Semantics<'a> {
        let mut semantics = Semantics { surfaces: Vec::new(), rest: &[], missing: 1, lost: 0 };
        let Some(text) = text else { return semantics };
        let Ok(Document { surfaces: SurfaceList(surfaces), values }) = serde_json::from_str(text.get())
        else {
            semantics.lost += 1;
            return semantics;
        };
        let count = surfaces.len() as u64;
        // (Parents and children are redundant, and either may be missing.)
        let mut parents: Vec<Option<u64>> = vec![None; surfaces.len()];
        for (number, text) in (0..).zip(&surfaces) {
            let (surface, mut lost) = Surface::of(text.get(), first + number);
            // (`Surface::of` has already counted an error.)
            let _ = each_member(text.get(), |key, value| match key {
                "parent" => match value.parse().ok().filter(|parent| *parent < count) {
                    Some(parent) => parents[number as usize] = Some(parent),
                    None => lost += 1,
                },
                "children" => match serde_json::from_str::<Vec<u64>>(value) {
                    Ok(list) => {
                        for child in list {
                            match parents.get_mut(child as usize) {
                                Some(parent) => *parent = parent.or(Some(number)),
                                None => lost += 1,
                            }
                        }
                    }
                    Err(_) => lost += 1,
                },
                _ => {}
            });
            semantics.surfaces.push(surface);
            semantics.lost += lost;
        }
        for (surface, parent) in semantics.surfaces.iter_mut().zip(parents) {
            surface.parent = parent.map(|parent| (first + parent).to_string());
        }
        if let Some(values) = values {
            let are_numbers = |byte: &u8| b"[]0123456789,null \t\r\n".contains(byte);
            match values.get().as_bytes().iter().all(are_numbers) {
                true => (semantics.rest, semantics.missing) = (values.get().as_bytes(), 0),
                false => semantics.lost += 1,
            }
        }
        semantics
    }

    /// Number of surfaces.
    pub(super) fn len(&self) -> u64 {
        self.surfaces.len() as u64
    }

    /// Number of dropped values: surfaces without faces, and values that are invalid or too long.
    pub(super) fn lost(&self) -> u64 {
        self.lost + self.surfaces.iter().filter(|surface| !surface.has_faces).count() as u64
    }

    /// Enters a list.
    pub(super) fn begin_list(&mut self) {
        if self.missing == 0 {
            match self.next() {
                Token::Begin => {
                    self.rest = &self.rest[1..];
                    return;
                }
                Token::Null => self.pass_value(),
                Token::Number(_) => self.lose_value(),
                Token::End => self.lost += 1,
            }
        }
        // (Nothing in this list has semantics.)
        self.missing += 1;
    }

    /// Leaves a list, which may be longer than the list of boundaries.
    pub(super) fn end_list(&mut self) {
        if self.missing > 0 {
            self.missing -= 1;
            return;
        }
        loop {
            match self.next() {
                Token::End => break,
                Token::Null => self.pass_value(),
                Token::Begin | Token::Number(_) => self.lose_value(),
            }
        }
        self.rest = self.rest.get(1..).unwrap_or_default();
    }

    /// Advances to the next face of the list and returns its values.
    pub(super) fn next_face(&mut self) -> Vec<(&str, &str)> {
        if self.missing > 0 {
            return Vec::new();
        }
        let number = match self.next() {
            Token::Number(number) if number < self.surfaces.len() => {
                self.pass_value();
                number
            }
            other => {
                match other {
                    Token::Null => self.pass_value(),
                    Token::End => self.lost += 1,
                    Token::Begin | Token::Number(_) => self.lose_value(),
                }
                return Vec::new();
            }
        };
        let Surface { number, kind, parent, attributes, has_faces } = &mut self.surfaces[number];
        *has_faces = true;
        let values = [(TYPE, &*kind), (PARENT, &*parent), (ATTRIBUTES, &*attributes)];
        let values = values.into_iter().filter_map(|(name, json)| Some((name, json.as_deref()?)));
        std::iter::once((SURFACE, number.as_str())).chain(values).collect()
    }

    /// Next token. Skips blanks and commas before it, but does not consume it.
    fn next(&mut self) -> Token {
        let blanks = self.rest.iter().take_while(|byte| b", \t\r\n".contains(byte)).count();
        self.rest = &self.rest[blanks..];
        match self.rest.first() {
            Some(b'[') => Token::Begin,
            Some(b'n') => Token::Null,
            Some(b'0'..=b'9') => {
                let digits = self.rest.iter().take_while(|byte| byte.is_ascii_digit()).count();
                let text = str::from_utf8(&self.rest[..digits]).unwrap_or_default();
                Token::Number(text.parse().unwrap_or(usize::MAX))
            }
            _ => Token::End,
        }
    }

    /// Skips the next value: a number, null, or a list with its content.
    fn pass_value(&mut self) {
        let mut depth = 0u64;
        let end = self.rest.iter().position(|byte| {
            match byte {
                b'[' => depth += 1,
                b']' if depth > 0 => depth -= 1,
                b']' | b',' => return depth == 0,
                _ => {}
            }
            false
        });
        self.rest = &self.rest[end.unwrap_or(self.rest.len())..];
    }

    /// Skips the next value, which is invalid.
    fn lose_value(&mut self) {
        self.lost += 1;
        self.pass_value();
    }
}

/// Start of the next value in nested lists of numbers.
enum Token {
    Begin,
    Null,
    Number(usize),
    /// End of the list, or of the text.
    End,
}

impl Surface {
    /// Parses a surface from a JSON object. Also returns the number of its dropped members.
    fn of(text: &str, number: u64) -> (Surface, u64) {
        let (mut surface, mut others) =
            (Surface { number: number.to_string(), ..Surface::default() }, ObjectText::default());
        let mut lost = 0;
        let known = each_member(text, |key, value| match key {
            "parent" | "children" => {}
            "type" if value.len() <= MAX_VALUE_BYTES => surface.kind = Some(value.into()),
            "type" => lost += 1,
            _ => others.push(key, value),
        });
        let others = Some(others).filter(|others| !others.is_empty()).map(|others| others.to_string());
        lost += u64::from(known.is_err())
            + u64::from(others.as_ref().is_some_and(|text| text.len() > MAX_VALUE_BYTES));
        surface.attributes = others.filter(|text| text.len() <= MAX_VALUE_BYTES);
        (surface, lost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Surface names of faces in nested lists of the given lengths, and the number of lost values.
    fn walked(semantics: &str, shells: &[usize]) -> (String, u64) {
        let text: &RawValue = serde_json::from_str(semantics).unwrap();
        let mut semantics = Semantics::of(Some(text), 0);
        let mut found = String::new();
        semantics.begin_list();
        for faces in shells {
            semantics.begin_list();
            for _ in 0..*faces {
                let values = semantics.next_face();
                found += values.first().map_or("-", |(_, number)| number);
            }
            semantics.end_list();
        }
        semantics.end_list();
        (found, semantics.lost())
    }

    #[test]
    fn semantic_values_are_read_like_boundaries() {
        let with = |values: &str| format!("{{\"surfaces\":[{{}},{{}},{{}}],\"values\":{values}}}");
        for (values, expected, lost) in [
            ("[[0,1],[2]]", "012", 0),
            (" [ [ 0 , null ] , [ 2 ] ] ", "0-2", 1),
            ("[null,[2]]", "--2", 2),
            ("[[2,1],null]", "21-", 1),
            ("null", "---", 3),
            ("[[0,1],[2,1,null]]", "012", 1),
            ("[[0],[1,2]]", "0-1", 3),
            ("[[0,[1,[2]]],[1]]", "0-1", 2),
            ("[[0,7],[99999999999999999999999]]", "0--", 4),
            ("[0,[2]]", "--2", 3),
            ("[[0,1]]", "01-", 2),
            ("[]", "---", 5),
            ("[[0,1],[2],[1],3]", "012", 2),
            ("[[0,1.5],[2]]", "---", 4),
            ("{\"a\":[]}", "---", 4),
        ] {
            assert_eq!(walked(&with(values), &[2, 1]), (expected.into(), lost), "{values}");
        }
    }

    #[test]
    fn surfaces_say_what_they_are() {
        let long = "x".repeat(MAX_VALUE_BYTES);
        let text = format!(
            "{{\"surfaces\":[{{\"type\":\"Wall\",\"children\":[1,9]}},{{\"slope\": 1.50,\"type\":\"Window\"}},\
             {{\"parent\":1,\"long\":\"{long}\"}},7],\"values\":[0,1,2,3]}}"
        );
        let mut semantics = Semantics::of(Some(serde_json::from_str(&text).unwrap()), 10);
        semantics.begin_list();
        assert_eq!(semantics.next_face(), [(SURFACE, "10"), (TYPE, "\"Wall\"")]);
        let window =
            [(SURFACE, "11"), (TYPE, "\"Window\""), (PARENT, "10"), (ATTRIBUTES, "{\"slope\":1.50}")];
        assert_eq!(semantics.next_face(), window);
        assert_eq!(semantics.next_face(), [(SURFACE, "12"), (PARENT, "11")]);
        assert_eq!(semantics.next_face(), [(SURFACE, "13")]);
        semantics.end_list();
        // A missing child, attributes that are too long, and a surface that is not an object.
        assert_eq!(semantics.lost(), 3);
        let surfaces =
            |count: usize| format!("{{\"surfaces\":[{}{{}}],\"values\":[0]}}", "{},".repeat(count - 1));
        let most = surfaces(MAX_SURFACES);
        assert_eq!(Semantics::of(Some(serde_json::from_str(&most).unwrap()), 0).len(), MAX_SURFACES as u64);
        for wrong in [&*surfaces(MAX_SURFACES + 1), "7", "[]", "{\"surfaces\":{}}"] {
            let mut semantics = Semantics::of(Some(serde_json::from_str(wrong).unwrap()), 0);
            semantics.begin_list();
            assert_eq!((semantics.next_face().len(), semantics.lost()), (0, 1));
        }
    }
}

//! Semantics of the surfaces of CityJSON geometries, which become values of faces.

use std::fmt;

use serde::de::{self, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::value::RawValue;
use spinney_brep::attributes::{ObjectText, each_member};

/// Column of the number that a face's surface has in its object: several faces may be of one.
pub(crate) const SURFACE: &str = "surface";
/// Column of the type of a face's surface: "RoofSurface".
pub(crate) const TYPE: &str = "type";
/// Column of the number of the surface that a face's surface is a part of, such as the wall of a window.
pub(crate) const PARENT: &str = "parent";
/// Column of what else is said of a face's surface: a JSON object.
pub(crate) const ATTRIBUTES: &str = "attributes";

/// The member of the text about a part that has the level of detail of its geometry, unless that is 2.
pub(crate) const LOD: &str = "lod";

/// Most bytes of a type, and of attributes of a surface. Each face of a surface has them, so that files grow by as much with each number of two
/// bytes.
const MAX_BYTES: usize = 4096;

/// Most surfaces of a geometry that have semantics: a few bytes of a file make a hundred in memory.
const MAX_SURFACES: usize = 1 << 20;

/// Semantics of a geometry's surfaces. Their numbers, lists as the boundaries have them, are gone through beside these, without building
/// anything of them.
pub(super) struct Semantics<'a> {
    surfaces: Vec<Surface>,
    /// The rest of the lists of numbers.
    rest: &'a [u8],
    /// Depth of lists below a place where there are no numbers; 0 where there are some.
    missing: u32,
    lost: u64,
}

/// A surface: the values of its faces.
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

/// JSON texts of surfaces.
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
    /// Those of a JSON text, if there is one; surfaces are numbered from `first` on.
    pub(super) fn of(text: Option<&'a RawValue>, first: u64) -> Semantics<'a> {
        let mut semantics = Semantics { surfaces: Vec::new(), rest: &[], missing: 1, lost: 0 };
        let Some(text) = text else { return semantics };
        let Ok(Document { surfaces: SurfaceList(surfaces), values }) = serde_json::from_str(text.get())
        else {
            semantics.lost += 1;
            return semantics;
        };
        let count = surfaces.len() as u64;
        // (Parents and children say the same, and one of them may be missing.)
        let mut parents: Vec<Option<u64>> = vec![None; surfaces.len()];
        for (number, text) in (0..).zip(&surfaces) {
            let (surface, mut lost) = Surface::of(text.get(), first + number);
            // (An error was counted already.)
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

    /// Number of values that are not handed out: surfaces without faces, and what makes no sense or is too long.
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
        // (Nothing is said of all that is in it.)
        self.missing += 1;
    }

    /// Leaves a list, which may have more than the boundaries have.
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

    /// Goes on to the next face of the list; its values.
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

    /// The next part of the text; blanks and commas before it are passed.
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

    /// Passes over what comes next: a number, null, or a list with all that is in it.
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

    /// Passes over what comes next and should not be there.
    fn lose_value(&mut self) {
        self.lost += 1;
        self.pass_value();
    }
}

/// Beginning of what comes next in lists of numbers.
enum Token {
    Begin,
    Null,
    Number(usize),
    /// End of the list, or of the text.
    End,
}

impl Surface {
    /// A surface of a JSON object, and the number of its members that are too long to be kept.
    fn of(text: &str, number: u64) -> (Surface, u64) {
        let (mut surface, mut others) =
            (Surface { number: number.to_string(), ..Surface::default() }, ObjectText::default());
        let mut lost = 0;
        let known = each_member(text, |key, value| match key {
            "parent" | "children" => {}
            "type" if value.len() <= MAX_BYTES => surface.kind = Some(value.into()),
            "type" => lost += 1,
            _ => others.push(key, value),
        });
        let others = Some(others).filter(|others| !others.is_empty()).map(|others| others.to_string());
        lost +=
            u64::from(known.is_err()) + u64::from(others.as_ref().is_some_and(|text| text.len() > MAX_BYTES));
        surface.attributes = others.filter(|text| text.len() <= MAX_BYTES);
        (surface, lost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names of the surfaces of faces in lists of lists, given by their lengths, and how many values are lost.
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
    fn numbers_are_found_beside_the_boundaries() {
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
        let long = "x".repeat(MAX_BYTES);
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
        // A child that is not there, attributes that are too long, and a surface that is no object.
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

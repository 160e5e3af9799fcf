//! Well-known text: version 1 (OGC 01-009) and version 2 (ISO 19162).

use super::{Epsg, MAX_LENGTH, number_text, unit_of_angle, unit_of_length};

/// Maximum nesting depth of brackets; real definitions have a dozen levels.
const MAX_LEVELS: usize = 64;

/// Keywords of coordinate reference systems: those in units of length, geographic, compound, and
/// bound ones.
const LINEAR: [&str; 12] = [
    "PROJCS",
    "PROJCRS",
    "PROJECTEDCRS",
    "DERIVEDPROJCRS",
    "GEOCCS",
    "LOCAL_CS",
    "ENGCRS",
    "ENGINEERINGCRS",
    "VERT_CS",
    "VERTCRS",
    "VERTICALCRS",
    "FITTED_CS",
];
pub(crate) const GEOGRAPHIC: [&str; 5] = ["GEOGCS", "GEOGCRS", "GEOGRAPHICCRS", "GEODCRS", "GEODETICCRS"];
const COMPOUND: [&str; 2] = ["COMPD_CS", "COMPOUNDCRS"];
pub(crate) const BOUND: [&str; 1] = ["BOUNDCRS"];

/// Keywords of coordinate reference systems in version 2.
pub(crate) const WKT2: [&str; 13] = [
    "PROJCRS",
    "PROJECTEDCRS",
    "DERIVEDPROJCRS",
    "GEOGCRS",
    "GEOGRAPHICCRS",
    "GEODCRS",
    "GEODETICCRS",
    "VERTCRS",
    "VERTICALCRS",
    "ENGCRS",
    "ENGINEERINGCRS",
    "COMPOUNDCRS",
    "BOUNDCRS",
];

/// Nodes for people that do not affect the definition.
const IGNORED_WORDS: [&str; 7] = ["USAGE", "SCOPE", "AREA", "BBOX", "VERTICALEXTENT", "TIMEEXTENT", "REMARK"];

/// A keyword with the items in its brackets.
#[derive(Debug, PartialEq)]
pub(crate) struct WktNode {
    /// In upper case.
    keyword: String,
    items: Vec<Item>,
}

#[derive(Debug, PartialEq)]
enum Item {
    WktNode(WktNode),
    /// A quoted string.
    Text(String),
    Number(f64),
    /// A name without quotes, in upper case, such as the direction of an axis.
    Word(String),
}

/// Parses a coordinate reference system. The error describes what was found.
pub(crate) fn parse(text: &str) -> Result<WktNode, String> {
    if text.len() > MAX_LENGTH {
        return Err(format!("{} bytes", text.len()));
    }
    let mut parser = Parser { text, at: 0 };
    let node = match parser.item(0)? {
        Item::WktNode(node) if node.is_crs() => node,
        Item::WktNode(node) => return Err(format!("the keyword {}", super::shortened(&node.keyword, 40))),
        _ => return Err("no keyword with brackets".into()),
    };
    match parser.peek() {
        None => Ok(node),
        Some(c) => Err(format!("`{}` after the last bracket", c.escape_debug())),
    }
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
}

impl Parser<'_> {
    /// Skips whitespace and returns the next character.
    fn peek(&mut self) -> Option<char> {
        let rest = &self.text[self.at..];
        self.at += rest.len() - rest.trim_start().len();
        self.text[self.at..].chars().next()
    }

    fn found(&mut self) -> String {
        let at = self.at;
        self.peek().map_or("the end of the string".into(), |c| format!("`{}` at byte {at}", c.escape_debug()))
    }

    fn item(&mut self, level: usize) -> Result<Item, String> {
        if level > MAX_LEVELS {
            return Err(format!("brackets nested more than {MAX_LEVELS} levels deep"));
        }
        match self.peek() {
            Some('"') => self.quoted().map(Item::Text),
            Some(c) if c.is_ascii_alphanumeric() || "+-._".contains(c) => {
                let rest = &self.text[self.at..];
                let end = rest.find(|c: char| !c.is_ascii_alphanumeric() && !"+-._".contains(c));
                let word = &rest[..end.unwrap_or(rest.len())];
                self.at += word.len();
                // (`inf` and `nan` are words.)
                let is_number = word.starts_with(|c: char| !c.is_ascii_alphabetic());
                if let Some(number) =
                    word.parse::<f64>().ok().filter(|number| is_number && number.is_finite())
                {
                    return Ok(Item::Number(number));
                }
                let keyword = word.to_ascii_uppercase();
                match self.peek() {
                    Some(open @ ('[' | '(')) => {
                        self.items(open, level).map(|items| Item::WktNode(WktNode { keyword, items }))
                    }
                    _ => Ok(Item::Word(keyword)),
                }
            }
            _ => Err(self.found()),
        }
    }

    /// Parses the items from an opening bracket, which comes next, to the closing one.
    fn items(&mut self, open: char, level: usize) -> Result<Vec<Item>, String> {
        let close = if open == '[' { ']' } else { ')' };
        self.at += 1;
        let mut items = Vec::new();
        loop {
            items.push(self.item(level + 1)?);
            match self.peek() {
                Some(',') => self.at += 1,
                Some(c) if c == close => {
                    self.at += 1;
                    return Ok(items);
                }
                _ => return Err(self.found()),
            }
        }
    }

    /// Parses a quoted string. Two consecutive quotes in it mean one.
    fn quoted(&mut self) -> Result<String, String> {
        let mut text = String::new();
        loop {
            let rest = &self.text[self.at + 1..];
            let end = rest.find('"').ok_or("an unclosed quote")?;
            text.push_str(&rest[..end]);
            self.at += end + 2;
            if !self.text[self.at..].starts_with('"') {
                return Ok(text);
            }
            text.push('"');
        }
    }
}

impl WktNode {
    pub(crate) fn keyword(&self) -> &str {
        &self.keyword
    }

    pub(crate) fn is_crs(&self) -> bool {
        self.is(&LINEAR) || self.is(&GEOGRAPHIC) || self.is(&COMPOUND) || self.is(&BOUND)
    }

    pub(crate) fn is(&self, keywords: &[&str]) -> bool {
        keywords.contains(&self.keyword.as_str())
    }

    pub(crate) fn nodes(&self) -> impl Iterator<Item = &WktNode> {
        self.items.iter().filter_map(|item| if let Item::WktNode(node) = item { Some(node) } else { None })
    }

    pub(crate) fn child(&self, keywords: &[&str]) -> Option<&WktNode> {
        self.nodes().find(|node| node.is(keywords))
    }

    /// Returns the quoted strings.
    pub(crate) fn strings(&self) -> impl Iterator<Item = &str> {
        self.items
            .iter()
            .filter_map(|item| if let Item::Text(text) = item { Some(text.as_str()) } else { None })
    }

    pub(crate) fn numbers(&self) -> impl Iterator<Item = f64> {
        self.items
            .iter()
            .filter_map(|item| if let Item::Number(number) = item { Some(*number) } else { None })
    }

    /// Returns the names without quotes, in upper case.
    pub(crate) fn words(&self) -> impl Iterator<Item = &str> {
        self.items
            .iter()
            .filter_map(|item| if let Item::Word(word) = item { Some(word.as_str()) } else { None })
    }

    /// Returns the horizontal component of a compound system, and any other system itself.
    pub(crate) fn horizontal(&self) -> Option<&WktNode> {
        if self.is(&COMPOUND) { self.nodes().find(|node| node.is_crs())?.horizontal() } else { Some(self) }
    }

    pub(super) fn name(&self) -> Option<String> {
        match (self.items.first(), self.child(&["SOURCECRS"])) {
            (Some(Item::Text(name)), _) => Some(name.clone()),
            (_, Some(source)) => source.nodes().next()?.name(),
            _ => None,
        }
    }

    /// Returns the EPSG codes of the whole system, or of both components of a compound one.
    pub(super) fn epsg(&self) -> Option<Epsg> {
        if let Some(number) = self.number() {
            return Some(Epsg::new(number));
        }
        let mut parts = self.nodes().filter(|node| node.is_crs());
        let (true, horizontal, vertical, None) =
            (self.is(&COMPOUND), parts.next()?, parts.next()?, parts.next())
        else {
            return None;
        };
        Some(Epsg { horizontal: horizontal.number()?, vertical: Some(vertical.number()?) })
    }

    /// Returns the node's own EPSG code.
    pub(crate) fn number(&self) -> Option<u32> {
        let id = self.child(&["ID", "AUTHORITY"])?;
        match id.items.as_slice() {
            [Item::Text(authority), number, ..] if authority.eq_ignore_ascii_case("EPSG") => match number {
                Item::Text(text) => text.parse().ok(),
                Item::Number(number) => Some(*number as u32).filter(|whole| f64::from(*whole) == *number),
                _ => None,
            },
            _ => None,
        }
        .filter(|number| *number > 0)
    }

    /// Returns the unit of the horizontal axes.
    pub(super) fn unit(&self) -> Option<&'static str> {
        if self.is(&BOUND) {
            return self.child(&["SOURCECRS"])?.nodes().next()?.unit();
        }
        if self.is(&COMPOUND) {
            return self.horizontal()?.unit();
        }
        let of_length = |node: &WktNode| unit_of_length(node.child(&["LENGTHUNIT", "UNIT"])?.factor()?);
        let of_angle = |node: &WktNode| unit_of_angle(node.child(&["ANGLEUNIT", "UNIT"])?.factor()?);
        let unit = |node: &WktNode| match self.is(&GEOGRAPHIC) {
            // (Geodetic systems may be geocentric, in metres.)
            true => of_angle(node).or_else(|| of_length(node)),
            false => of_length(node),
        };
        // A unit for all axes, or one for each axis.
        unit(self).or_else(|| unit(self.child(&["AXIS"])?))
    }

    /// Returns the number after a unit's name.
    fn factor(&self) -> Option<f64> {
        self.numbers().next()
    }

    /// Returns a string that is equal for equivalent definitions.
    pub(super) fn normalised(&self) -> String {
        let mut text = String::new();
        self.write(&mut text);
        text
    }

    fn write(&self, text: &mut String) {
        text.push_str(&self.keyword);
        text.push('[');
        for item in &self.items {
            match item {
                Item::WktNode(node) if node.is(&IGNORED_WORDS) => continue,
                Item::WktNode(node) => node.write(text),
                Item::Text(quoted) => text.push_str(&format!("{quoted:?}")),
                Item::Number(number) => text.push_str(&number_text(*number)),
                Item::Word(word) => text.push_str(word),
            }
            text.push(',');
        }
        text.push(']');
    }
}

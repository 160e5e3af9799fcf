//! Coordinate systems, defined as they came.

mod epsg;
pub(crate) mod geo_keys;
mod proj_string;
mod projjson;
mod registered;
mod registry;
mod wkt;

use std::fmt;

use serde::{Deserialize, Serialize};

pub use self::epsg::Epsg;
pub use self::geo_keys::GeoKeys;
pub(super) use self::proj_string::{
    metres as metres_of_unit, parse as parse_proj_string, value as proj_value,
};
pub(super) use self::projjson::{number as number_of_json, parse as parse_projjson};
pub(super) use self::wkt::{BOUND, GEOGRAPHIC, WKT2, WktNode, parse as parse_wkt};
use crate::web_mercator::{WEB_MERCATOR, WEB_MERCATOR_HALF};
use spinney_base::{Error, Result};

/// Bytes of a definition in one text; real ones have a few thousand.
const MOST: usize = 1 << 20;

/// A coordinate system, in the form in which it was defined.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub enum Crs {
    /// By numbers of the EPSG registry.
    Epsg(Epsg),
    /// By the keys of a GeoTIFF file.
    GeoKeys(GeoKeys),
    /// In well-known text, of version 1 (OGC 01-009) or 2 (ISO 19162).
    Wkt(String),
    /// In PROJ's JSON.
    ProjJson(String),
    /// In PROJ's words, `+proj=...`.
    Proj(String),
}

// (A derived one is compiled anew wherever a frame is cloned.)
impl Clone for Crs {
    fn clone(&self) -> Crs {
        match self {
            Crs::Epsg(epsg) => Crs::Epsg(*epsg),
            Crs::GeoKeys(keys) => Crs::GeoKeys(keys.clone()),
            Crs::Wkt(text) => Crs::Wkt(text.clone()),
            Crs::ProjJson(text) => Crs::ProjJson(text.clone()),
            Crs::Proj(text) => Crs::Proj(text.clone()),
        }
    }
}

impl Crs {
    /// The system with this number in the EPSG registry.
    pub const fn epsg(number: u32) -> Crs {
        Crs::Epsg(Epsg::new(number))
    }

    /// Reads a definition: `EPSG:4326`, `EPSG:4326+5773`, the like as URN or URL, WKT, PROJJSON, or PROJ's words
    /// (`+proj=utm +zone=32 +datum=WGS84`).
    ///
    /// # Errors
    /// If the text is none of these, or too long.
    pub fn parse(text: &str) -> Result<Crs> {
        let text = text.trim_start_matches('\u{feff}').trim_matches(|c: char| c.is_whitespace() || c == '\0');
        let invalid = |found: String, expected: &str| Error::invalid("coordinate system", found, expected);
        let forms = "EPSG:4326, EPSG:4326+5773, WKT, PROJJSON, or +proj=...";
        if let Some(epsg) = parse_numbers(text) {
            return Ok(Crs::Epsg(epsg));
        }
        if text.starts_with('{') {
            projjson::parse(text)
                .map_err(|found| invalid(found, "the PROJJSON of a coordinate system, of at most 1 MiB"))?;
            return Ok(Crs::ProjJson(text.into()));
        }
        if text.starts_with('+') {
            proj_string::parse(text).map_err(|found| {
                invalid(found, "PROJ's words of a coordinate system, each once, of at most 1 MiB")
            })?;
            return Ok(Crs::Proj(text.into()));
        }
        if text.contains(['[', '(']) {
            wkt::parse(text)
                .map_err(|found| invalid(found, "the WKT of a coordinate system, of at most 1 MiB"))?;
            return Ok(Crs::Wkt(text.into()));
        }
        Err(invalid(format!("`{}`", shortened(text, 60)), forms))
    }

    /// Fails if the system is named by numbers that the EPSG registry does not have: for what people write. (Files may be newer than the
    /// registry that this was compared with.)
    ///
    /// ```
    /// use spinney::Crs;
    /// assert!(Crs::epsg(3035).check_registered().is_ok());
    /// assert!(Crs::epsg(999_999).check_registered().is_err());
    /// ```
    ///
    /// # Errors
    /// If so.
    pub fn check_registered(&self) -> Result<()> {
        let Crs::Epsg(Epsg { horizontal, vertical }) = self else { return Ok(()) };
        let mut numbers = [Some(*horizontal), *vertical].into_iter().flatten();
        match numbers.find(|number| !registered::is_registered(*number)) {
            None => Ok(()),
            Some(number) => {
                let expected = "a number of a coordinate system in the EPSG registry, or a definition as WKT, PROJJSON or +proj=...";
                Err(Error::invalid("coordinate system", format!("EPSG:{number}, which is none"), expected))
            }
        }
    }

    /// The numbers that name the system whole, if the definition has them.
    pub fn numbers(&self) -> Option<Epsg> {
        match self {
            Crs::Epsg(epsg) => Some(*epsg),
            Crs::GeoKeys(keys) => keys.epsg(),
            Crs::Wkt(text) => wkt::parse(text).ok()?.epsg(),
            Crs::ProjJson(text) => projjson::epsg(&projjson::parse(text).ok()?),
            Crs::Proj(_) => None,
        }
    }

    /// The name that the definition gives the system.
    pub fn name(&self) -> Option<String> {
        let name = match self {
            Crs::Epsg(_) | Crs::Proj(_) => None,
            Crs::GeoKeys(keys) => keys.name(),
            Crs::Wkt(text) => wkt::parse(text).ok()?.name(),
            Crs::ProjJson(text) => projjson::name(&projjson::parse(text).ok()?),
        };
        name.filter(|name| !name.is_empty())
    }

    /// The form of the definition: "EPSG", "GeoTIFF keys", "WKT", "PROJJSON" or "PROJ string".
    pub fn form(&self) -> &'static str {
        match self {
            Crs::Epsg(_) => "EPSG",
            Crs::GeoKeys(_) => "GeoTIFF keys",
            Crs::Wkt(_) => "WKT",
            Crs::ProjJson(_) => "PROJJSON",
            Crs::Proj(_) => "PROJ string",
        }
    }

    /// The definition as text; that of GeoTIFF keys is `NUMBER=VALUE` for each of them.
    pub fn definition(&self) -> String {
        match self {
            Crs::Epsg(epsg) => epsg.to_string(),
            Crs::GeoKeys(keys) => keys.to_string(),
            Crs::Wkt(text) | Crs::ProjJson(text) | Crs::Proj(text) => text.clone(),
        }
    }

    /// A definition that [`Crs::parse`] reads: numbers where they are known, else WKT, else the definition as it is.
    pub fn short_definition(&self) -> String {
        let text = || self.to_wkt2().unwrap_or_else(|_| self.definition());
        self.numbers().map_or_else(text, |numbers| numbers.to_string())
    }

    /// The unit in which the system's plane is measured: "degrees", "m", "ft", "us-ft" or "km". `None` if it is
    /// another one or unknown.
    pub fn unit(&self) -> Option<&'static str> {
        match self {
            Crs::Epsg(epsg) => epsg.unit(),
            Crs::GeoKeys(keys) => keys.unit(),
            Crs::Wkt(text) => wkt::parse(text).ok()?.unit(),
            Crs::ProjJson(text) => projjson::unit(&projjson::parse(text).ok()?),
            Crs::Proj(text) => proj_string::unit(text),
        }
        .or_else(|| self.numbers()?.unit())
    }

    /// How far the first coordinate leads once round the world: 360 degrees of longitude, or the side of web mercator's square in
    /// metres; `None` of systems that do not come again.
    pub fn turn(&self) -> Option<f64> {
        match self.numbers() {
            _ if self.unit() == Some("degrees") => Some(360.0),
            Some(epsg) if epsg.in_parts().horizontal == WEB_MERCATOR => Some(2.0 * WEB_MERCATOR_HALF),
            _ => None,
        }
    }

    /// Whether two definitions mean the same system: they name the same numbers, have the same parts, such as one by number and a `.prj` file
    /// with the same parameters, or say the same in the same form, what is only told to people aside.
    ///
    /// Those in different forms that are not understood are taken for different.
    pub fn is_same(&self, other: &Crs) -> bool {
        let has_same_parts = || self.identity().is_some_and(|identity| Some(identity) == other.identity());
        self == other || self.normalised() == other.normalised() || has_same_parts()
    }

    /// Text that is the same for the same systems.
    fn normalised(&self) -> String {
        if let Some(epsg) = self.numbers() {
            return epsg.in_parts().to_string();
        }
        let text = match self {
            Crs::Epsg(_) => None,
            Crs::GeoKeys(keys) => Some(keys.normalised()),
            Crs::Wkt(text) => wkt::parse(text).ok().map(|node| node.normalised()),
            Crs::ProjJson(text) => projjson::parse(text).ok().map(|value| projjson::normalised(&value)),
            Crs::Proj(text) => proj_string::normalised(text),
        };
        format!("{} {}", self.form(), text.unwrap_or_else(|| self.definition()))
    }

    /// Fails if two things, each with its name for messages, lie in different systems, or one in none.
    pub fn check_same(a: (&str, Option<&Crs>), b: (&str, Option<&Crs>)) -> Result<()> {
        let ((here, expected), (there, found)) = (a, b);
        match (expected, found) {
            (None, None) => return Ok(()),
            (Some(expected), Some(found)) if expected.is_same(found) => return Ok(()),
            _ => {}
        }
        let show = |crs: Option<&Crs>| crs.map_or("none".into(), Crs::to_string);
        let (found, expected) = (show(found), show(expected));
        let other = if found == expected { "another one: " } else { "" };
        let known = a.1.or(b.1).map_or(String::new(), |crs| format!(" {}", crs.short_definition()));
        let expected = format!(
            "{expected}, as {here} has; if all are in one system: build with --crs{known}; otherwise build a tree of each, and \
             `spinney combine over` brings one to the other"
        );
        Err(Error::invalid(format!("coordinate system of {there}"), format!("{other}{found}"), expected))
    }
}

/// Numbers of the registry, as `EPSG:4326+5773`, `urn:ogc:def:crs:EPSG::7415`,
/// `urn:ogc:def:crs,crs:EPSG::28992,crs:EPSG::5709` or `http://www.opengis.net/def/crs/EPSG/0/7415`.
fn parse_numbers(text: &str) -> Option<Epsg> {
    let lower = text.to_ascii_lowercase();
    if let Some(numbers) = lower.strip_prefix("epsg:") {
        return Epsg::parse_numbers(numbers.trim_start_matches(':'));
    }
    let number = |part: &str| {
        // Authority, version (if any) and number.
        let (_, behind) = part.split_once("epsg")?;
        let (version, number) = behind.rsplit_once([':', '/'])?;
        version.chars().all(|c| ":/.v".contains(c) || c.is_ascii_digit()).then_some(())?;
        Epsg::parse_numbers(number).filter(|epsg| epsg.vertical.is_none()).map(|epsg| epsg.horizontal)
    };
    if let Some(parts) = lower.strip_prefix("urn:ogc:def:crs,") {
        let (horizontal, vertical) = parts.split_once(',')?;
        return Some(Epsg { horizontal: number(horizontal)?, vertical: Some(number(vertical)?) });
    }
    let is_reference =
        ["urn:ogc:def:crs:epsg:", "urn:x-ogc:def:crs:epsg:"].iter().any(|start| lower.starts_with(start))
            || lower.starts_with("http") && lower.contains("/def/crs/epsg/");
    Some(Epsg::new(number(&lower).filter(|_| is_reference)?))
}

/// The unit of so many metres.
fn unit_of_length(metres: f64) -> Option<&'static str> {
    let units = [("m", 1.0), ("ft", 0.3048), ("us-ft", 1200.0 / 3937.0), ("km", 1000.0)];
    units.into_iter().find(|(_, factor)| (metres / factor - 1.0).abs() < 1e-9).map(|(name, _)| name)
}

/// The unit of so many radians.
fn unit_of_angle(radians: f64) -> Option<&'static str> {
    ((radians / 1f64.to_radians() - 1.0).abs() < 1e-9).then_some("degrees")
}

/// A number as text that is the same for the same number.
fn number_text(number: f64) -> String {
    // (That makes a zero of a negative zero.)
    format!("{:?}", number + 0.0)
}

/// So many characters of a text, and a sign that there are more.
fn shortened(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.into(),
    }
}

/// Number and name, or name and form where there is no number.
impl fmt::Display for Crs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.name().map(|name| shortened(&name, 200));
        match (self.numbers(), name) {
            (Some(epsg), Some(name)) => write!(f, "{epsg} ({name})"),
            (Some(epsg), None) => epsg.fmt(f),
            (None, Some(name)) => write!(f, "{name} ({} without an EPSG number)", self.form()),
            (None, None) => write!(f, "{} without an EPSG number", self.form()),
        }
    }
}

#[cfg(test)]
mod tests;

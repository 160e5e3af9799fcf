//! Coordinate reference systems in their original definitions.

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

/// Maximum length of a definition in bytes; real ones have a few thousand.
const MAX_LENGTH: usize = 1 << 20;

/// A coordinate reference system, in its original form of definition.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub enum Crs {
    /// EPSG codes.
    Epsg(Epsg),
    /// Keys of a GeoTIFF file.
    GeoKeys(GeoKeys),
    /// Well-known text, of version 1 (OGC 01-009) or 2 (ISO 19162).
    Wkt(String),
    /// PROJJSON.
    ProjJson(String),
    /// A PROJ string, `+proj=...`.
    Proj(String),
}

// (Not derived: the compiler would instantiate a derived implementation wherever a frame is
// cloned.)
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
    /// Returns the system with an EPSG code.
    pub const fn epsg(number: u32) -> Crs {
        Crs::Epsg(Epsg::new(number))
    }

    /// Parses a definition: `EPSG:4326`, `EPSG:4326+5773`, the equivalent URN or URL, WKT,
    /// PROJJSON, or a PROJ string (`+proj=utm +zone=32 +datum=WGS84`).
    ///
    /// # Errors
    /// If the string is none of these, or is too long.
    pub fn parse(text: &str) -> Result<Crs> {
        let text = text.trim_start_matches('\u{feff}').trim_matches(|c: char| c.is_whitespace() || c == '\0');
        let invalid = |found: String, expected: &str| Error::invalid("coordinate system", found, expected);
        let forms = "EPSG:4326, EPSG:4326+5773, WKT, PROJJSON, or +proj=...";
        if let Some(epsg) = parse_numbers(text) {
            return Ok(Crs::Epsg(epsg));
        }
        if text.starts_with('{') {
            projjson::parse(text)
                .map_err(|found| invalid(found, "PROJJSON of a coordinate system, at most 1 MiB"))?;
            return Ok(Crs::ProjJson(text.into()));
        }
        if text.starts_with('+') {
            proj_string::parse(text).map_err(|found| {
                invalid(found, "a PROJ string of a coordinate system, each parameter once, at most 1 MiB")
            })?;
            return Ok(Crs::Proj(text.into()));
        }
        if text.contains(['[', '(']) {
            wkt::parse(text).map_err(|found| invalid(found, "WKT of a coordinate system, at most 1 MiB"))?;
            return Ok(Crs::Wkt(text.into()));
        }
        Err(invalid(format!("`{}`", shortened(text, 60)), forms))
    }

    /// Checks that the system's EPSG codes exist in the registry. Meant for user input: files may
    /// be newer than the version of the registry that is known here.
    ///
    /// ```
    /// use spinney::Crs;
    /// assert!(Crs::epsg(3035).check_registered().is_ok());
    /// assert!(Crs::epsg(999_999).check_registered().is_err());
    /// ```
    ///
    /// # Errors
    /// If a code is not registered.
    pub fn check_registered(&self) -> Result<()> {
        let Crs::Epsg(Epsg { horizontal, vertical }) = self else { return Ok(()) };
        let mut numbers = [Some(*horizontal), *vertical].into_iter().flatten();
        match numbers.find(|number| !registered::is_registered(*number)) {
            None => Ok(()),
            Some(number) => {
                let expected = "the number of a coordinate system in the EPSG registry, or a definition as WKT, PROJJSON or +proj=...";
                Err(Error::invalid(
                    "coordinate system",
                    format!("EPSG:{number}, which is not registered"),
                    expected,
                ))
            }
        }
    }

    /// Returns the EPSG codes of the whole system, if the definition has them.
    pub fn numbers(&self) -> Option<Epsg> {
        match self {
            Crs::Epsg(epsg) => Some(*epsg),
            Crs::GeoKeys(keys) => keys.epsg(),
            Crs::Wkt(text) => wkt::parse(text).ok()?.epsg(),
            Crs::ProjJson(text) => projjson::epsg(&projjson::parse(text).ok()?),
            Crs::Proj(_) => None,
        }
    }

    /// Returns the system's name in the definition.
    pub fn name(&self) -> Option<String> {
        let name = match self {
            Crs::Epsg(_) | Crs::Proj(_) => None,
            Crs::GeoKeys(keys) => keys.name(),
            Crs::Wkt(text) => wkt::parse(text).ok()?.name(),
            Crs::ProjJson(text) => projjson::name(&projjson::parse(text).ok()?),
        };
        name.filter(|name| !name.is_empty())
    }

    /// Returns the form of the definition: "EPSG", "GeoTIFF keys", "WKT", "PROJJSON" or "PROJ
    /// string".
    pub fn form(&self) -> &'static str {
        match self {
            Crs::Epsg(_) => "EPSG",
            Crs::GeoKeys(_) => "GeoTIFF keys",
            Crs::Wkt(_) => "WKT",
            Crs::ProjJson(_) => "PROJJSON",
            Crs::Proj(_) => "PROJ string",
        }
    }

    /// Returns the definition as a string; for GeoTIFF keys, `NUMBER=VALUE` for each key.
    pub fn definition(&self) -> String {
        match self {
            Crs::Epsg(epsg) => epsg.to_string(),
            Crs::GeoKeys(keys) => keys.to_string(),
            Crs::Wkt(text) | Crs::ProjJson(text) | Crs::Proj(text) => text.clone(),
        }
    }

    /// Returns a definition that [`Crs::parse`] reads: EPSG codes if they are known, otherwise WKT
    /// if possible, otherwise the original definition.
    pub fn short_definition(&self) -> String {
        let text = || self.to_wkt2().unwrap_or_else(|_| self.definition());
        self.numbers().map_or_else(text, |numbers| numbers.to_string())
    }

    /// Returns the unit of the horizontal axes: "degrees", "m", "ft", "us-ft" or "km". `None` if it
    /// is another one or unknown.
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

    /// Whether the horizontal coordinates are longitude and latitude, in any unit of angles.
    pub fn is_geographic(&self) -> bool {
        self.unit() == Some("degrees") || self.numbers().is_some_and(Epsg::is_geographic)
    }

    /// Returns the period of the first coordinate around the world: 360 degrees of longitude, or
    /// the side of the Web Mercator square in metres. `None` for systems that are not periodic.
    pub fn turn(&self) -> Option<f64> {
        match self.numbers() {
            _ if self.unit() == Some("degrees") => Some(360.0),
            Some(epsg) if epsg.in_parts().horizontal == WEB_MERCATOR => Some(2.0 * WEB_MERCATOR_HALF),
            _ => None,
        }
    }

    /// Whether two definitions mean the same system: they have the same EPSG codes or the same
    /// components (such as a code and a `.prj` file with the same parameters), or are equal in the
    /// same form except for remarks.
    ///
    /// Definitions in different forms that cannot be interpreted are considered different.
    pub fn is_same(&self, other: &Crs) -> bool {
        let has_same_parts = || self.identity().is_some_and(|identity| Some(identity) == other.identity());
        self == other || self.normalised() == other.normalised() || has_same_parts()
    }

    /// Returns a string that is equal for equal systems.
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

    /// Checks that two things, each with its name for messages, have the same system, or both have
    /// none.
    pub fn check_same(a: (&str, Option<&Crs>), b: (&str, Option<&Crs>)) -> Result<()> {
        let ((here, expected), (there, found)) = (a, b);
        match (expected, found) {
            (None, None) => return Ok(()),
            (Some(expected), Some(found)) if expected.is_same(found) => return Ok(()),
            _ => {}
        }
        let show = |crs: Option<&Crs>| crs.map_or("none".into(), Crs::to_string);
        let (found, expected) = (show(found), show(expected));
        let other = if found == expected { "another system, " } else { "" };
        let known = a.1.or(b.1).map_or(String::new(), |crs| format!(" {}", crs.short_definition()));
        let expected = format!(
            "{expected}, as {here} has; if all are in one system, build with --crs{known}; otherwise build a tree of each: \
             `spinney combine over` reprojects one to the other"
        );
        Err(Error::invalid(format!("coordinate system of {there}"), format!("{other}{found}"), expected))
    }
}

/// Parses EPSG codes, such as `EPSG:4326+5773`, `urn:ogc:def:crs:EPSG::7415`,
/// `urn:ogc:def:crs,crs:EPSG::28992,crs:EPSG::5709` or
/// `http://www.opengis.net/def/crs/EPSG/0/7415`.
fn parse_numbers(text: &str) -> Option<Epsg> {
    let lower = text.to_ascii_lowercase();
    if let Some(numbers) = lower.strip_prefix("epsg:") {
        return Epsg::parse_numbers(numbers.trim_start_matches(':'));
    }
    let number = |part: &str| {
        // Authority, version (if any) and number.
        let (_, after_authority) = part.split_once("epsg")?;
        let (version, number) = after_authority.rsplit_once([':', '/'])?;
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

/// Returns the unit of a length in metres.
fn unit_of_length(metres: f64) -> Option<&'static str> {
    let units = [("m", 1.0), ("ft", 0.3048), ("us-ft", 1200.0 / 3937.0), ("km", 1000.0)];
    units.into_iter().find(|(_, factor)| (metres / factor - 1.0).abs() < 1e-9).map(|(name, _)| name)
}

/// Returns the unit of an angle in radians.
fn unit_of_angle(radians: f64) -> Option<&'static str> {
    ((radians / 1f64.to_radians() - 1.0).abs() < 1e-9).then_some("degrees")
}

/// Formats a number uniquely.
fn number_text(number: f64) -> String {
    // (Adding 0.0 turns -0.0 into 0.0.)
    format!("{:?}", number + 0.0)
}

/// Shortens a string to a number of characters, followed by dots.
fn shortened(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.into(),
    }
}

/// Formats code and name, or name and form if there is no code.
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

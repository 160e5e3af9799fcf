//! Definitions of coordinate systems in PROJ's words: `+proj=utm +zone=32 +ellps=GRS80`.

use super::datum::{self, Datum};
use super::{geo_keys, proj_string, projjson, wkt};
use crate::Crs;

/// A system in PROJ's words.
#[derive(Debug, PartialEq)]
pub(super) struct Definition {
    /// The projection, its ellipsoid and its units, without a shift of the datum.
    pub(super) words: String,
    /// The way to WGS 84.
    pub(super) datum: Datum,
}

/// The definition of a system. An error says what was found.
pub(super) fn read(crs: &Crs) -> Result<Definition, String> {
    if crs.numbers().is_none() {
        return match crs {
            Crs::Epsg(_) => Err("no number".into()),
            Crs::GeoKeys(keys) => geo_keys::read(keys),
            Crs::Wkt(text) => wkt::read(text),
            Crs::ProjJson(text) => projjson::read(text),
            Crs::Proj(text) => proj_string::read(text),
        };
    }
    let text = proj_string_of(crs)?;
    Ok(Definition { words: datum::without(text), datum: Datum::of(text) })
}

/// The definition of a system that has a number.
fn proj_string_of(crs: &Crs) -> Result<&'static str, String> {
    let number = crs.numbers().ok_or("no number")?.in_parts().horizontal;
    let known = u16::try_from(number).ok().and_then(crs_definitions::from_code);
    match known.map(|known| known.proj4).filter(|text| !text.is_empty()) {
        Some(text) if crs.unit().is_none() => Err(format!("`{text}` with a unit that is not known")),
        Some(text) => Ok(text),
        None => Err(format!("EPSG:{number}, which the list of definitions does not have")),
    }
}

/// A parameter of a definition.
pub(super) fn parameter<'a>(definition: &'a str, name: &str) -> Option<&'a str> {
    let mut parts = definition.split_whitespace().filter_map(|part| part.strip_prefix('+')?.split_once('='));
    parts.find(|(own, _)| *own == name).map(|(_, value)| value)
}

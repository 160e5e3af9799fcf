//! Reads definitions of coordinate reference systems in any form.

use super::datum::Datum;
use super::definition::Definition;
use super::{geo_keys, proj_string, projjson, wkt, words};
use crate::Crs;
use crate::registry::definition_of;

/// Reads the definition of a system. The error describes what was found.
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
    Ok(Definition { words: words::without_shift(&text), datum: Datum::of(&text) })
}

/// Returns the PROJ string of a system with an EPSG code.
fn proj_string_of(crs: &Crs) -> Result<String, String> {
    let number = crs.numbers().ok_or("no number")?.plane();
    match u16::try_from(number).ok().and_then(definition_of) {
        Some(text) if crs.unit().is_none() => Err(format!("`{text}` with a unit that is not known")),
        Some(text) => Ok(text),
        None => Err(format!("EPSG:{number}, whose definition is not built in")),
    }
}

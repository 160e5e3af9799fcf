//! Definitions of coordinate systems in PROJ's words: `+proj=utm +zone=32 +ellps=GRS80`.

use crate::space::Crs;

/// The definition of a system. An error says what was found.
pub(super) fn proj_string(crs: &Crs) -> Result<String, String> {
    let Some(epsg) = crs.numbers() else {
        return Err(format!("a definition in {} without an EPSG number", crs.form()));
    };
    let number = epsg.in_parts().horizontal;
    let known = u16::try_from(number).ok().and_then(crs_definitions::from_code);
    match known.map(|known| known.proj4).filter(|text| !text.is_empty()) {
        Some(text) if crs.unit().is_none() => Err(format!("`{text}` with a unit that is not known")),
        Some(text) => Ok(text.into()),
        None => Err(format!("EPSG:{number}, which the list of definitions does not have")),
    }
}

/// A parameter of a definition.
pub(super) fn parameter<'a>(definition: &'a str, name: &str) -> Option<&'a str> {
    let mut parts = definition.split_whitespace().filter_map(|part| part.strip_prefix('+')?.split_once('='));
    parts.find(|(own, _)| *own == name).map(|(_, value)| value)
}

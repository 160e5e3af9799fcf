//! PROJJSON 0.7.

use serde_json::Value;

use super::{Epsg, MAX_LENGTH, number_text, unit_of_angle, unit_of_length};

/// Members for programs and people that do not affect the definition.
const IGNORED_WORDS: [&str; 8] =
    ["$schema", "usages", "scope", "area", "bbox", "vertical_extent", "temporal_extent", "remarks"];

/// Parses a coordinate reference system. The error describes what was found.
pub(crate) fn parse(text: &str) -> Result<Value, String> {
    if text.len() > MAX_LENGTH {
        return Err(format!("{} bytes", text.len()));
    }
    // (The parser limits the nesting depth.)
    let value: Value = serde_json::from_str(text).map_err(|error| error.to_string())?;
    match value["type"].as_str() {
        Some(kind) if kind.ends_with("CRS") => Ok(value),
        kind => Err(format!("the type {}", super::shortened(kind.unwrap_or("nothing"), 40))),
    }
}

pub(super) fn name(value: &Value) -> Option<String> {
    value["name"].as_str().or_else(|| value["source_crs"]["name"].as_str()).map(String::from)
}

/// Returns the EPSG codes of the whole system, or of both components of a compound one.
pub(super) fn epsg(value: &Value) -> Option<Epsg> {
    if let Some(number) = number(value) {
        return Some(Epsg::new(number));
    }
    match value["components"].as_array()?.as_slice() {
        [horizontal, vertical] => {
            Some(Epsg { horizontal: number(horizontal)?, vertical: Some(number(vertical)?) })
        }
        _ => None,
    }
}

pub(crate) fn number(value: &Value) -> Option<u32> {
    let id = &value["id"];
    let is_epsg = id["authority"].as_str()?.eq_ignore_ascii_case("EPSG");
    let code = &id["code"];
    let number = code.as_u64().and_then(|number| u32::try_from(number).ok());
    number.or_else(|| code.as_str()?.parse().ok()).filter(|number| is_epsg && *number > 0)
}

/// Returns the unit of the horizontal axes.
pub(super) fn unit(value: &Value) -> Option<&'static str> {
    // Nested systems: the horizontal component of a compound system, or the source of a bound
    // system.
    let inner = [&value["components"][0], &value["source_crs"]].into_iter().find(|inner| inner.is_object());
    let unit = &inner.unwrap_or(value)["coordinate_system"]["axis"][0]["unit"];
    match (unit.as_str(), unit["conversion_factor"].as_f64()) {
        (Some("metre"), _) => Some("m"),
        (Some("degree"), _) => Some("degrees"),
        (None, Some(factor)) if unit["type"] == "LinearUnit" => unit_of_length(factor),
        (None, Some(factor)) if unit["type"] == "AngularUnit" => unit_of_angle(factor),
        _ => None,
    }
}

/// Returns a string that is equal for equivalent definitions: members are sorted, and those that
/// define nothing are left out.
pub(super) fn normalised(value: &Value) -> String {
    let mut text = String::new();
    write(value, &mut text);
    text
}

fn write(value: &Value, text: &mut String) {
    match value {
        Value::Object(members) => {
            let mut members: Vec<_> =
                members.iter().filter(|(name, _)| !IGNORED_WORDS.contains(&name.as_str())).collect();
            members.sort_by_key(|(name, _)| *name);
            text.push('{');
            for (name, value) in members {
                text.push_str(&format!("{name:?}:"));
                write(value, text);
                text.push(',');
            }
            text.push('}');
        }
        Value::Array(items) => {
            text.push('[');
            for item in items {
                write(item, text);
                text.push(',');
            }
            text.push(']');
        }
        // (1 and 1.0 are the same number.)
        Value::Number(number) => text.push_str(&number.as_f64().map_or(number.to_string(), number_text)),
        other => text.push_str(&other.to_string()),
    }
}

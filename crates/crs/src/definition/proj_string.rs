//! PROJ strings: `+proj=utm +zone=32 +datum=WGS84`.

use super::{MAX_LENGTH, unit_of_length};

/// Words for programs that do not affect the definition.
const IGNORED_WORDS: [&str; 4] = ["no_defs", "type", "wktext", "title"];

/// Parses the words of a definition, with their values if they have any. The error describes what
/// was found.
pub(crate) fn parse(text: &str) -> Result<Vec<(&str, Option<&str>)>, String> {
    if text.len() > MAX_LENGTH {
        return Err(format!("{} bytes", text.len()));
    }
    let mut words: Vec<(&str, Option<&str>)> = Vec::new();
    for part in text.split_whitespace() {
        let shown = || format!("`{}`", super::shortened(part, 40));
        let word = part.strip_prefix('+').ok_or_else(shown)?;
        let (name, value) = match word.split_once('=') {
            Some((name, value)) => (name, Some(value)),
            None => (word, None),
        };
        let is_name =
            !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_');
        let is_value = |value: &str| {
            !value.is_empty()
                && value.bytes().all(|byte| byte.is_ascii_graphic() && byte != b'"' && byte != b'=')
        };
        if !is_name || !value.is_none_or(is_value) {
            return Err(shown());
        }
        // (Real definitions have about ten words. The limit keeps the next line cheap.)
        if words.len() == 64 || words.iter().any(|(own, _)| *own == name) {
            return Err(format!("{} twice, or more than 64 parameters", shown()));
        }
        words.push((name, value));
    }
    let method = words.iter().find(|(name, _)| *name == "proj").and_then(|(_, value)| *value);
    if method.is_some() { Ok(words) } else { Err("no +proj=".into()) }
}

/// Returns the value of a word.
pub(crate) fn value<'a>(words: &[(&str, Option<&'a str>)], name: &str) -> Option<&'a str> {
    words.iter().find(|(own, _)| *own == name).and_then(|(_, value)| *value)
}

/// Returns the length of a unit in metres.
pub(crate) fn metres(name: &str) -> Option<f64> {
    match name {
        "m" => Some(1.0),
        "km" => Some(1000.0),
        "ft" => Some(0.3048),
        "us-ft" => Some(1200.0 / 3937.0),
        _ => None,
    }
}

/// Returns the unit of the horizontal axes.
pub(super) fn unit(text: &str) -> Option<&'static str> {
    let words = parse(text).ok()?;
    match (value(&words, "proj"), value(&words, "units"), value(&words, "to_meter")) {
        (Some("longlat" | "latlong" | "lonlat" | "latlon"), ..) => Some("degrees"),
        (_, Some(name), None) => unit_of_length(metres(name)?),
        (_, None, Some(size)) => unit_of_length(size.parse().ok()?),
        (_, None, None) => Some("m"),
        _ => None,
    }
}

/// Returns a string that is equal for equivalent definitions.
pub(super) fn normalised(text: &str) -> Option<String> {
    let mut words = parse(text).ok()?;
    words.retain(|(name, _)| !IGNORED_WORDS.contains(name));
    words.sort_unstable();
    let words =
        words.into_iter().map(|(name, value)| match value.map(|value| (value, value.parse::<f64>())) {
            Some((_, Ok(number))) if number.is_finite() => format!("+{name}={}", super::number_text(number)),
            Some((value, _)) => format!("+{name}={value}"),
            None => format!("+{name}"),
        });
    Some(words.collect::<Vec<_>>().join(" "))
}

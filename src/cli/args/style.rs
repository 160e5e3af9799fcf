//! Styles as people give them.

use std::path::Path;

use spinney::style::Style;

/// Reads a style: a name, a JSON document, or a file with one.
pub(crate) fn parse_style(text: &str) -> Result<Style, String> {
    let is_text = text.trim_start().starts_with('{') || Style::names().contains(&text);
    // (A name that is no style's may be a file's.)
    let style = if !is_text && (text.contains(['.', '/', '\\']) || Path::new(text).exists()) {
        Style::read(Path::new(text))
    } else {
        Style::parse(text)
    };
    style.map_err(|error| error.to_string())
}

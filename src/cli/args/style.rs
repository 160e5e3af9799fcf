//! Styles as arguments.

use spinney::style::Style;

/// Parses a style: a name, a JSON document, or a file with one.
pub(crate) fn parse_style(text: &str) -> Result<Style, String> {
    Style::given(text).map_err(|error| error.to_string())
}

//! Writer for the nested keywords of well-known text, for both versions.

use std::fmt::{Display, Write as _};

/// Well-known text under construction: keywords with brackets, whose items are separated by commas.
pub(super) struct Text {
    text: String,
}

impl Text {
    pub(super) fn new() -> Text {
        Text { text: String::new() }
    }

    /// Writes a keyword with the items that `inner` writes into its brackets.
    pub(super) fn node(&mut self, keyword: &str, inner: &mut dyn FnMut(&mut Text)) {
        self.separate();
        self.text.push_str(keyword);
        self.text.push('[');
        inner(self);
        self.text.push(']');
    }

    /// Writes a quoted string, on one line and at most 200 characters long, which other programs
    /// accept.
    pub(super) fn quoted(&mut self, text: &str) -> &mut Text {
        self.separate();
        let plain = text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(200);
        let plain: String = plain.collect();
        let _ = write!(self.text, "\"{}\"", plain.trim().replace('"', "\"\""));
        self
    }

    /// Writes a number, or a word without quotes.
    pub(super) fn plain(&mut self, item: impl Display) -> &mut Text {
        self.separate();
        let _ = write!(self.text, "{item}");
        self
    }

    fn separate(&mut self) {
        if !self.text.is_empty() && !self.text.ends_with('[') {
            self.text.push(',');
        }
    }

    pub(super) fn finish(self) -> String {
        self.text
    }
}

//! Nested keywords of well-known text, as both versions write them.

use std::fmt::{Display, Write as _};

/// Text in the making: keywords with brackets, what is in them divided by commas.
pub(super) struct Text {
    text: String,
}

impl Text {
    pub(super) fn new() -> Text {
        Text { text: String::new() }
    }

    /// A keyword with what `inner` writes into its brackets.
    pub(super) fn node(&mut self, keyword: &str, inner: &mut dyn FnMut(&mut Text)) {
        self.separate();
        self.text.push_str(keyword);
        self.text.push('[');
        inner(self);
        self.text.push(']');
    }

    /// A text in quotes, on one line and of a length that programs take.
    pub(super) fn quoted(&mut self, text: &str) -> &mut Text {
        self.separate();
        let plain = text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(200);
        let plain: String = plain.collect();
        let _ = write!(self.text, "\"{}\"", plain.trim().replace('"', "\"\""));
        self
    }

    /// A number, or a word without quotes.
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

//! Text that does nothing to a terminal but appear on it.

use std::borrow::Cow;

/// Text without control characters other than line ends and tabs: names and metadata of files may hold escape
/// sequences, with which a terminal can be made to show, or do, anything. They appear as in Rust's strings.
pub(crate) fn printable(text: &str) -> Cow<'_, str> {
    let is_harmless = |c: char| !c.is_control() || c == '\n' || c == '\t';
    if text.chars().all(is_harmless) {
        return text.into();
    }
    let mut clean = String::with_capacity(text.len());
    for c in text.chars() {
        if is_harmless(c) { clean.push(c) } else { clean.extend(c.escape_default()) }
    }
    clean.into()
}

#[cfg(test)]
mod tests {
    use super::printable;

    #[test]
    fn escape_sequences_are_shown_and_not_done() {
        assert_eq!(printable("a\u{1b}[31mb\n\tc\u{9b}2J\u{7f}é"), "a\\u{1b}[31mb\n\tc\\u{9b}2J\\u{7f}é");
        assert_eq!(printable("nothing\n"), "nothing\n");
    }
}

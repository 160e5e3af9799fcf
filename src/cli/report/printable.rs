//! Text that is safe to print on a terminal.

use std::borrow::Cow;
use std::io::{self, Write};

use spinney::raw::report::printable_json;

/// Escapes control characters other than line ends and tabs, as in Rust's strings. Names and
/// metadata of files may have escape sequences that make a terminal show, or do, anything.
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

/// Escapes control characters of a line of text or of JSON.
pub(crate) fn printable_line(line: &str) -> Cow<'_, str> {
    if line.starts_with(['{', '[']) { printable_json(line) } else { printable(line) }
}

/// Formats a field of a CSV table, with quotes where needed (RFC 4180).
pub(crate) fn csv_field(field: &str) -> Cow<'_, str> {
    match field.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", field.replace('"', "\"\"")).into(),
        false => field.into(),
    }
}

/// A writer that escapes control characters like [`printable`]: for tables that are printed unless
/// a file is named.
pub(crate) struct PrintableWriter<W: Write> {
    inner: W,
    /// A byte whose meaning depends on the next one: the first of two bytes that may encode a
    /// control character, or a carriage return, which may end a line.
    pending: Option<u8>,
}

impl<W: Write> PrintableWriter<W> {
    pub(crate) fn new(inner: W) -> PrintableWriter<W> {
        PrintableWriter { inner, pending: None }
    }

    fn put(clean: &mut Vec<u8>, byte: u8) {
        match byte {
            b'\n' | b'\t' | 0x20..=0x7e | 0x80.. => clean.push(byte),
            _ => clean.extend(char::from(byte).escape_default().map(|c| c as u8)),
        }
    }
}

impl<W: Write> Write for PrintableWriter<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut clean = Vec::with_capacity(bytes.len());
        for &byte in bytes {
            match (self.pending.take(), byte) {
                (Some(b'\r'), b'\n') => clean.extend(b"\r\n"),
                (Some(0xc2), 0x80..=0x9f) => {
                    clean.extend(char::from(byte).escape_default().map(|c| c as u8));
                }
                (pending, _) => {
                    pending.iter().for_each(|before| Self::put(&mut clean, *before));
                    match byte {
                        b'\r' | 0xc2 => self.pending = Some(byte),
                        _ => Self::put(&mut clean, byte),
                    }
                }
            }
        }
        self.inner.write_all(&clean)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_are_escaped_however_they_are_cut() {
        let text = "a\u{1b}[31mb\r\nc\u{9b}2J\u{7f}é\tÂ\rd\n";
        for size in 1..text.len() {
            let mut writer = PrintableWriter::new(Vec::new());
            text.as_bytes().chunks(size).for_each(|chunk| writer.write_all(chunk).unwrap());
            let clean = String::from_utf8(writer.inner).unwrap();
            assert_eq!(clean, "a\\u{1b}[31mb\r\nc\\u{9b}2J\\u{7f}é\tÂ\\rd\n", "{size}");
        }
        assert_eq!(printable_line("a\u{9b}"), "a\\u{9b}");
        assert_eq!(printable_line("{\"a\":\"\u{9b}\"}"), "{\"a\":\"\\u009b\"}");
    }

    #[test]
    fn escape_sequences_are_shown_and_not_done() {
        assert_eq!(printable("a\u{1b}[31mb\n\tc\u{9b}2J\u{7f}é"), "a\\u{1b}[31mb\n\tc\\u{9b}2J\\u{7f}é");
        assert_eq!(printable("nothing\n"), "nothing\n");
    }
}

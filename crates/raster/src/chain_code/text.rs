//! Tokenizer of text of any length, which tracks line numbers for messages.

use std::io::Read;
use std::path::{Path, PathBuf};

use spinney_base::io::{FileAccess, InputFile};
use spinney_base::{Error, Result};

/// Bytes read at a time.
const PART: usize = 1 << 16;
/// Maximum length of a word in bytes; no valid word is longer.
const LONGEST_WORD: usize = 64;
/// Maximum length of a line in the head, in bytes: a coordinate system definition, or the colours
/// of 65,536 classes.
const LONGEST_LINE: usize = 1 << 20;

/// A text file, read sequentially.
pub(super) struct Text {
    path: PathBuf,
    file: InputFile,
    part: Vec<u8>,
    at: usize,
    /// Current line number, from 1.
    pub(super) line: u64,
}

impl Text {
    /// Opens a file.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub(super) fn open(path: &Path, access: &FileAccess) -> Result<Text> {
        Ok(Text { path: path.into(), file: access.input(path)?, part: Vec::new(), at: 0, line: 1 })
    }

    /// Returns the next byte without consuming it.
    pub(super) fn peek(&mut self) -> Result<Option<u8>> {
        if self.at == self.part.len() {
            self.part.clear();
            self.at = 0;
            let read = self.file.by_ref().take(PART as u64).read_to_end(&mut self.part);
            read.map_err(Error::io(&self.path, "read"))?;
        }
        Ok(self.part.get(self.at).copied())
    }

    /// Consumes the next byte.
    pub(super) fn pass(&mut self) {
        self.line += u64::from(self.part.get(self.at) == Some(&b'\n'));
        self.at += 1;
    }

    /// Skips white space and returns the next byte, or `None` at the end.
    pub(super) fn skip_space(&mut self) -> Result<Option<u8>> {
        loop {
            match self.peek()? {
                Some(byte) if byte.is_ascii_whitespace() => self.pass(),
                other => return Ok(other),
            }
        }
    }

    /// Returns the next word, or `None` at the end.
    pub(super) fn word(&mut self) -> Result<Option<String>> {
        self.skip_space()?;
        let mut word = Vec::new();
        while let Some(byte) = self.peek()?.filter(|byte| !byte.is_ascii_whitespace()) {
            if word.len() == LONGEST_WORD {
                word.extend_from_slice(b"...");
                return Err(self.wrong(&shown(&word), "a word or a number"));
            }
            word.push(byte);
            self.pass();
        }
        Ok((!word.is_empty()).then(|| String::from_utf8_lossy(&word).into_owned()))
    }

    /// Returns the rest of the line.
    pub(super) fn rest(&mut self) -> Result<String> {
        let mut rest = Vec::new();
        while let Some(byte) = self.peek()?.filter(|byte| *byte != b'\n') {
            if rest.len() == LONGEST_LINE {
                return Err(self.wrong("more than a million characters", "a shorter header line"));
            }
            rest.push(byte);
            self.pass();
        }
        match String::from_utf8(rest) {
            Ok(rest) => Ok(rest.trim().to_owned()),
            Err(_) => Err(self.wrong("bytes that are not UTF-8", "text in UTF-8")),
        }
    }

    /// Parses the next word with `read`.
    ///
    /// # Errors
    /// If there is no word, or `read` rejects it.
    pub(super) fn number<T>(&mut self, expected: &str, read: impl FnOnce(&str) -> Option<T>) -> Result<T> {
        let word = self.word()?;
        match word.as_deref().and_then(read) {
            Some(number) => Ok(number),
            None => Err(self
                .wrong(&word.map_or("the end of the file".into(), |word| shown(word.as_bytes())), expected)),
        }
    }

    /// Returns the error for unexpected content in the current line.
    pub(super) fn wrong(&self, found: &str, expected: &str) -> Error {
        self.wrong_in(self.line, found, expected)
    }

    /// Returns the error for unexpected content in another line.
    pub(super) fn wrong_in(&self, line: u64, found: &str, expected: &str) -> Error {
        Error::corrupt(&self.path, format!("line {line}"), found, expected)
    }

    /// Returns the error for an unsupported feature.
    pub(super) fn unsupported(&self, found: String, advice: &str) -> Error {
        Error::unsupported(&self.path, found, advice)
    }
}

/// Formats a word for messages: escaped, at most 60 characters.
pub(super) fn shown(word: &[u8]) -> String {
    format!(
        "`{}`",
        String::from_utf8_lossy(word).chars().take(60).flat_map(char::escape_debug).collect::<String>()
    )
}

//! Words and lines of a text of any length, and where they stand.

use std::io::Read;
use std::path::{Path, PathBuf};

use spinney_base::io::{FileAccess, InputFile};
use spinney_base::{Error, Result};

/// Bytes that are read at a time.
const PART: usize = 1 << 16;
/// Letters of a word, of those that there are.
const LONGEST_WORD: usize = 64;
/// Bytes of a line of the head: a definition of a coordinate system, or the colours of 65,536 classes.
const LONGEST_LINE: usize = 1 << 20;

/// A text that is read from its beginning.
pub(super) struct Text {
    path: PathBuf,
    file: InputFile,
    part: Vec<u8>,
    at: usize,
    /// Number of the line, from 1.
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

    /// The next byte, which stays the next.
    pub(super) fn peek(&mut self) -> Result<Option<u8>> {
        if self.at == self.part.len() {
            self.part.clear();
            self.at = 0;
            let read = self.file.by_ref().take(PART as u64).read_to_end(&mut self.part);
            read.map_err(Error::io(&self.path, "read"))?;
        }
        Ok(self.part.get(self.at).copied())
    }

    /// Goes past the next byte.
    pub(super) fn pass(&mut self) {
        self.line += u64::from(self.part.get(self.at) == Some(&b'\n'));
        self.at += 1;
    }

    /// Goes to the next byte that is no space; nothing at the end.
    pub(super) fn skip_space(&mut self) -> Result<Option<u8>> {
        loop {
            match self.peek()? {
                Some(byte) if byte.is_ascii_whitespace() => self.pass(),
                other => return Ok(other),
            }
        }
    }

    /// The next word; nothing at the end.
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

    /// The rest of the line.
    pub(super) fn rest(&mut self) -> Result<String> {
        let mut rest = Vec::new();
        while let Some(byte) = self.peek()?.filter(|byte| *byte != b'\n') {
            if rest.len() == LONGEST_LINE {
                return Err(self.wrong("more than a million letters", "a line of the head"));
            }
            rest.push(byte);
            self.pass();
        }
        match String::from_utf8(rest) {
            Ok(rest) => Ok(rest.trim().to_owned()),
            Err(_) => Err(self.wrong("bytes that are no letters", "text in UTF-8")),
        }
    }

    /// The next word as what a number is read by.
    ///
    /// # Errors
    /// If it is none, or `read` does not take it.
    pub(super) fn number<T>(&mut self, expected: &str, read: impl FnOnce(&str) -> Option<T>) -> Result<T> {
        let word = self.word()?;
        match word.as_deref().and_then(read) {
            Some(number) => Ok(number),
            None => Err(self
                .wrong(&word.map_or("the end of the text".into(), |word| shown(word.as_bytes())), expected)),
        }
    }

    /// The error that something stands in this line where something else should.
    pub(super) fn wrong(&self, found: &str, expected: &str) -> Error {
        self.wrong_in(self.line, found, expected)
    }

    /// The error of another line.
    pub(super) fn wrong_in(&self, line: u64, found: &str, expected: &str) -> Error {
        Error::corrupt(&self.path, format!("line {line}"), found, expected)
    }

    /// The error that the text uses what is not known.
    pub(super) fn unsupported(&self, found: String, advice: &str) -> Error {
        Error::unsupported(&self.path, found, advice)
    }
}

/// A word of a text, as messages show it.
pub(super) fn shown(word: &[u8]) -> String {
    format!(
        "`{}`",
        String::from_utf8_lossy(word).chars().take(60).flat_map(char::escape_debug).collect::<String>()
    )
}

//! Delimited text tables: fields separated by commas, semicolons, tabs or bars (RFC 4180).

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::{Path, PathBuf};

use super::encoding::TextEncoding;
use spinney_base::{Error, Result};

/// Rows of a table, in sequence.
pub(super) struct Rows {
    input: BufReader<File>,
    path: PathBuf,
    separator: u8,
    /// Maximum memory for a row in bytes.
    memory: u64,
    /// Contiguous fields of the current row.
    bytes: Vec<u8>,
    /// End of each field, and whether it was quoted.
    ends: Vec<(usize, bool)>,
}

/// Memory overhead per field in bytes: as read, and as a value.
const BYTES_EACH: u64 = 64;

/// Memory per byte of a field, which may be a text geometry.
const BYTES_FOR_BYTE: u64 = 16;

impl Rows {
    /// Starts at the first row. The separator is the most frequent candidate in that row.
    pub(super) fn open(file: File, path: &Path, memory: u64) -> Result<Rows> {
        let mut input = BufReader::with_capacity(1 << 16, file);
        let begin = input.fill_buf().map_err(Error::io(path, "read"))?;
        let line = begin.split(|byte| *byte == b'\n').next().unwrap_or_default();
        let count = |separator: u8| {
            let mut in_quotes = false;
            let is_one = |byte: &&u8| {
                in_quotes ^= **byte == b'"';
                !in_quotes && **byte == separator
            };
            line.iter().filter(is_one).count()
        };
        // In a tie, the last candidate wins.
        let separator = [b'|', b'\t', b';', b','].into_iter().max_by_key(|separator| count(*separator));
        let separator = separator.unwrap_or(b',');
        Ok(Rows { input, path: path.into(), separator, memory, bytes: Vec::new(), ends: Vec::new() })
    }

    /// Restarts at the first row.
    pub(super) fn rewind(&mut self) -> Result<()> {
        self.input.rewind().map_err(Error::io(&self.path, "read"))
    }

    /// Reads the next non-empty row; returns whether there is one. `number` is the feature number,
    /// for messages.
    pub(super) fn step(&mut self, number: u64) -> Result<bool> {
        loop {
            if !self.row(number)? {
                return Ok(false);
            }
            if self.ends.as_slice() != [(0, false)] {
                return Ok(true);
            }
        }
    }

    fn row(&mut self, number: u64) -> Result<bool> {
        self.bytes.clear();
        self.ends.clear();
        // Inside quotes, and after a quote that may have ended them.
        let (mut is_quoted, mut in_quotes, mut is_after_quote, mut is_begun) = (false, false, false, false);
        loop {
            let chunk = self.input.fill_buf().map_err(Error::io(&self.path, "read"))?;
            if chunk.is_empty() {
                if in_quotes && !is_after_quote {
                    let found = "the end of the file in a quoted field";
                    return Err(Error::corrupt(
                        &self.path,
                        format!("feature {number}"),
                        found,
                        "a closing quote",
                    ));
                }
                if is_begun {
                    self.ends.push((self.bytes.len(), is_quoted));
                }
                return Ok(is_begun);
            }
            is_begun = true;
            let mut taken = chunk.len();
            let mut is_done = false;
            for (index, &byte) in chunk.iter().enumerate() {
                if is_after_quote {
                    is_after_quote = false;
                    if byte == b'"' {
                        self.bytes.push(byte);
                        continue;
                    }
                    in_quotes = false;
                }
                let is_empty = self.bytes.len() == self.ends.last().map_or(0, |(end, _)| *end);
                match byte {
                    b'"' if in_quotes => is_after_quote = true,
                    _ if in_quotes => self.bytes.push(byte),
                    b'"' if is_empty && !is_quoted => (is_quoted, in_quotes) = (true, true),
                    b'\n' => {
                        is_done = true;
                        taken = index + 1;
                    }
                    byte if byte == self.separator => {
                        self.ends.push((self.bytes.len(), is_quoted));
                        is_quoted = false;
                    }
                    _ => self.bytes.push(byte),
                }
                if is_done {
                    break;
                }
            }
            self.input.consume(taken);
            let used = self.bytes.len() as u64 * BYTES_FOR_BYTE + self.ends.len() as u64 * BYTES_EACH;
            if used > self.memory {
                return Err(Error::TooLarge {
                    path: self.path.clone(),
                    what: format!("feature {number}"),
                    needed: used,
                    limit: self.memory,
                    advice: "allow more memory, or close an open quote".into(),
                });
            }
            if is_done {
                let begin = self.ends.last().map_or(0, |(end, _)| *end);
                if self.bytes[begin..].last() == Some(&b'\r') {
                    self.bytes.pop();
                }
                self.ends.push((self.bytes.len(), is_quoted));
                return Ok(true);
            }
        }
    }

    /// Returns the number of fields in the row.
    pub(super) fn len(&self) -> usize {
        self.ends.len()
    }

    /// Returns a field of the row, and whether it was quoted; empty after the last.
    pub(super) fn field(&self, index: usize) -> (std::borrow::Cow<'_, str>, bool) {
        let Some((end, is_quoted)) = self.ends.get(index) else { return ("".into(), false) };
        let begin = index.checked_sub(1).map_or(0, |before| self.ends[before].0);
        let bytes = &self.bytes[begin..*end];
        // With an undeclared encoding, all bytes decode to some string.
        (TextEncoding::Unknown.decode(bytes).unwrap_or_default(), *is_quoted)
    }
}

//! Tables as text: rows of fields with commas, semicolons, tabulators or bars between (RFC 4180).

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::{Path, PathBuf};

use super::encoding::TextEncoding;
use spinney_base::{Error, Result};

/// The rows of a table, one after the other.
pub(super) struct Rows {
    input: BufReader<File>,
    path: PathBuf,
    separator: u8,
    /// Bytes of memory that a row may take.
    memory: u64,
    /// The fields of the row in hand, one behind the other.
    bytes: Vec<u8>,
    /// Where they end, and whether they were in quotes.
    ends: Vec<(usize, bool)>,
}

/// Bytes of memory for a field besides its own: as it is read, and as a value.
const BYTES_EACH: u64 = 64;

/// Bytes of memory for each byte of a field: of a geometry in text, too.
const BYTES_FOR_BYTE: u64 = 16;

impl Rows {
    /// Begins with the first row; the separator is that of which it has the most.
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
        // (Of several that it has as many of, the first here.)
        let separator = [b'|', b'\t', b';', b','].into_iter().max_by_key(|separator| count(*separator));
        let separator = separator.unwrap_or(b',');
        Ok(Rows { input, path: path.into(), separator, memory, bytes: Vec::new(), ends: Vec::new() })
    }

    /// Begins again.
    pub(super) fn rewind(&mut self) -> Result<()> {
        self.input.rewind().map_err(Error::io(&self.path, "read"))
    }

    /// Reads the next row that is not empty; whether there is one. The number is that of the feature, for messages.
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
        // (In quotes, and behind a quote which may have ended them.)
        let (mut is_quoted, mut in_quotes, mut is_behind, mut is_begun) = (false, false, false, false);
        loop {
            let chunk = self.input.fill_buf().map_err(Error::io(&self.path, "read"))?;
            if chunk.is_empty() {
                if in_quotes && !is_behind {
                    let found = "the end of the file in a field in quotes";
                    return Err(Error::corrupt(&self.path, format!("feature {number}"), found, "a quote"));
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
                if is_behind {
                    is_behind = false;
                    if byte == b'"' {
                        self.bytes.push(byte);
                        continue;
                    }
                    in_quotes = false;
                }
                let is_empty = self.bytes.len() == self.ends.last().map_or(0, |(end, _)| *end);
                match byte {
                    b'"' if in_quotes => is_behind = true,
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
                    advice: "allow more, or look for a quote without another one".into(),
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

    /// Number of fields of the row.
    pub(super) fn len(&self) -> usize {
        self.ends.len()
    }

    /// A field of the row, and whether it was in quotes; nothing behind the last.
    pub(super) fn field(&self, index: usize) -> (std::borrow::Cow<'_, str>, bool) {
        let Some((end, is_quoted)) = self.ends.get(index) else { return ("".into(), false) };
        let begin = index.checked_sub(1).map_or(0, |before| self.ends[before].0);
        let bytes = &self.bytes[begin..*end];
        // (Where nobody says what texts are in, all bytes are some text.)
        (TextEncoding::Unknown.decode(bytes).unwrap_or_default(), *is_quoted)
    }
}

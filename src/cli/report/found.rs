//! Lines about the results of a search.

use std::collections::BTreeMap;
use std::io::{BufWriter, StdoutLock, Write as _, stdout};

use spinney::Error;

use super::printable_line;

/// Prints lines about search results: at once, or the largest blocks first.
pub(crate) struct Found {
    out: BufWriter<StdoutLock<'static>>,
    /// Number of lines that may still be printed.
    left: u64,
    /// Whether nothing was found.
    is_empty: bool,
    /// How many of the largest blocks to print, and the lines of the largest so far, by level, then
    /// by code.
    largest: Option<u32>,
    kept: BTreeMap<(u8, String), String>,
}

impl Found {
    pub(crate) fn new(limit: Option<u64>, largest: Option<u32>) -> Found {
        let out = BufWriter::new(stdout().lock());
        Found { out, left: limit.unwrap_or(u64::MAX), is_empty: true, largest, kept: BTreeMap::new() }
    }

    /// Adds a result. Returns whether to continue the search.
    pub(crate) fn take(&mut self, level: u8, code: &str, line: &dyn Fn() -> String) -> spinney::Result<bool> {
        self.is_empty = false;
        if let Some(most) = self.largest {
            let key = (level, code.to_string());
            let is_full = self.kept.len() >= most as usize;
            if !is_full || self.kept.last_key_value().is_some_and(|(last, _)| key < *last) {
                self.kept.insert(key, line());
            }
            if self.kept.len() > most as usize {
                self.kept.pop_last();
            }
            return Ok(true);
        }
        if self.left == 0 {
            return Ok(false);
        }
        self.left -= 1;
        self.write(&line()).map(|()| true)
    }

    /// Whether nothing was found, whatever the limit.
    pub(crate) fn is_empty(&self) -> bool {
        self.is_empty
    }

    fn write(&mut self, line: &str) -> spinney::Result<()> {
        writeln!(self.out, "{}", printable_line(line)).map_err(Error::io("-", "write"))
    }

    pub(crate) fn finish(&mut self) -> spinney::Result<()> {
        for line in std::mem::take(&mut self.kept).into_values() {
            self.write(&line)?;
        }
        self.out.flush().map_err(Error::io("-", "write"))
    }
}

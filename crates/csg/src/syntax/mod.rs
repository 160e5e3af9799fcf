//! The CSG language: tokens (`lexer.rs`), calls and lists (`parse.rs`), and keywords (`words.rs`).

mod lexer;
mod parse;
mod words;

pub(crate) use self::parse::parse;
pub(crate) use self::words::solid_of_patches;

use std::fmt;
use std::path::Path;

use spinney_base::Error;

/// A position in a text: line and column, counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct At {
    pub(crate) line: u32,
    pub(crate) column: u32,
}

impl fmt::Display for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}, column {}", self.line, self.column)
    }
}

/// Creates the error for an unexpected element at a position.
pub(crate) fn wrong(path: &Path, at: At, found: impl Into<String>, expected: impl Into<String>) -> Error {
    Error::invalid(format!("{}, {at}", path.display()), found, expected)
}

//! Lexer of the CSG language.

use std::path::Path;

use super::{At, wrong};
use crate::affine::MAX_NUMBER;
use spinney_base::Result;

/// A token.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Token<'a> {
    /// A name or a keyword.
    Name(&'a str),
    Number(f64),
    /// One of `( ) [ ] , ; =`.
    Sign(char),
    End,
}

impl Token<'_> {
    /// Returns the token as error messages show it.
    pub(super) fn text(&self) -> String {
        match self {
            Token::Name(name) => format!("`{}`", shortened(name)),
            Token::Number(number) => format!("the number {number}"),
            Token::Sign(sign) => format!("`{sign}`"),
            Token::End => "the end of the text".into(),
        }
    }
}

/// Shortens a string to at most 40 characters.
pub(super) fn shortened(text: &str) -> String {
    const MAX_SHOWN: usize = 40;
    match text.char_indices().nth(MAX_SHOWN) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.into(),
    }
}

/// Splits a text into tokens.
pub(super) struct Lexer<'a> {
    path: &'a Path,
    rest: &'a str,
    line: u32,
    column: u32,
}

impl<'a> Lexer<'a> {
    pub(super) fn new(path: &'a Path, text: &'a str) -> Lexer<'a> {
        Lexer { path, rest: text.strip_prefix('\u{feff}').unwrap_or(text), line: 1, column: 1 }
    }

    /// Returns the next token and its position.
    pub(super) fn next(&mut self) -> Result<(Token<'a>, At)> {
        self.skip_space();
        let at = At { line: self.line, column: self.column };
        let Some(first) = self.rest.chars().next() else { return Ok((Token::End, at)) };
        if "()[],;=".contains(first) {
            self.take(first.len_utf8());
            return Ok((Token::Sign(first), at));
        }
        if first.is_alphabetic() || first == '_' {
            let is_part = |c: char| c.is_alphanumeric() || c == '_';
            let end = self.rest.find(|c| !is_part(c)).unwrap_or(self.rest.len());
            return Ok((Token::Name(self.take(end)), at));
        }
        if first.is_ascii_digit() || "+-.".contains(first) {
            let text = self.take(number_end(self.rest));
            let expected = "a number such as 12, -0.5 or 1e-3";
            let number: f64 =
                text.parse().map_err(|_| wrong(self.path, at, format!("`{}`", shortened(text)), expected))?;
            if number.abs() > MAX_NUMBER {
                let found = format!("`{}`", shortened(text));
                return Err(wrong(self.path, at, found, "a number from -1e30 to 1e30"));
            }
            return Ok((Token::Number(number), at));
        }
        let expected = "names, numbers, brackets, commas and semicolons; # begins a comment";
        Err(wrong(self.path, at, format!("the character {first:?}"), expected))
    }

    /// Consumes bytes of the current line.
    fn take(&mut self, bytes: usize) -> &'a str {
        let (taken, rest) = self.rest.split_at(bytes);
        self.rest = rest;
        self.column += taken.chars().count() as u32;
        taken
    }

    /// Skips whitespace and comments.
    fn skip_space(&mut self) {
        loop {
            let Some(first) = self.rest.chars().next() else { return };
            if first == '\n' {
                self.rest = &self.rest[1..];
                self.line += 1;
                self.column = 1;
            } else if first.is_whitespace() {
                self.take(first.len_utf8());
            } else if first == '#' || self.rest.starts_with("//") {
                self.take(self.rest.find('\n').unwrap_or(self.rest.len()));
            } else {
                return;
            }
        }
    }
}

/// Returns the length of the number at the start of a text. It includes any characters that could
/// belong to a number, so that error messages show malformed numbers in full.
fn number_end(text: &str) -> usize {
    let mut before = ' ';
    text.find(|c: char| {
        let is_part =
            c.is_alphanumeric() || c == '.' || c == '_' || ("+-".contains(c) && " eE".contains(before));
        before = c;
        !is_part
    })
    .unwrap_or(text.len())
}

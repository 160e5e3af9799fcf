//! Parser of the CSG language. Calls are kept on an explicit stack, so nesting does not use the
//! call stack.

use std::collections::HashMap;
use std::path::Path;

use super::lexer::{Lexer, Token};
use super::words::{self, Arguments};
use super::{At, wrong};
use crate::model::{Builder, Csg, Solid, check_length};
use spinney_base::Result;

/// Maximum nesting depth of calls.
const MAX_DEPTH: usize = 1 << 12;

/// An argument of a call.
#[derive(Clone, Debug)]
pub(super) enum Argument {
    Number(f64),
    /// A list of numbers in brackets.
    Numbers(Vec<f64>),
    /// A list of points in brackets.
    Points(Vec<[f64; 2]>),
    /// A list of points in space in brackets.
    SpacePoints(Vec<[f64; 3]>),
    Solid(Solid),
}

/// A call whose arguments are being parsed.
struct Call<'a> {
    word: &'a str,
    at: At,
    arguments: Vec<(Argument, At)>,
}

/// Kind of a statement.
enum Statement<'a> {
    /// Assigns a name to a solid.
    Let(&'a str),
    /// A solid, or `bounds` or `unit`.
    Solid,
}

/// Parses a CSG text.
pub(crate) fn parse(path: &Path, text: &str) -> Result<Csg> {
    check_length(path, text)?;
    let mut parser =
        Parser { path, lexer: Lexer::new(path, text), builder: Builder::new(path), names: HashMap::new() };
    let mut solids = Vec::new();
    let (mut bounds, mut unit) = (None, None);
    loop {
        let (token, at) = parser.lexer.next()?;
        match token {
            Token::End if solids.is_empty() => {
                return Err(wrong(path, at, token.text(), "a solid, such as ball(0, 0, 0, 1);"));
            }
            Token::End => break,
            Token::Name("let") => {
                let name = parser.new_name()?;
                parser.sign('=')?;
                let (solid, _) = parser.solid()?;
                parser.names.insert(name, solid);
                parser.statement_end(&Statement::Let(name))?;
            }
            Token::Name("bounds") => {
                parser.sign('(')?;
                let arguments = parser.numbers_of("bounds", at)?;
                if bounds.replace(words::bounds(arguments)?).is_some() {
                    return Err(wrong(path, at, "a second `bounds`", "at most one"));
                }
                parser.statement_end(&Statement::Solid)?;
            }
            Token::Name("unit") => {
                let given = parser.unit()?;
                if unit.replace(given).is_some() {
                    return Err(wrong(path, at, "a second `unit`", "at most one"));
                }
                parser.statement_end(&Statement::Solid)?;
            }
            Token::Name(word) => {
                solids.push((parser.solid_of(word, at)?, at));
                parser.statement_end(&Statement::Solid)?;
            }
            other => {
                let expected = "a solid, or let, bounds or unit";
                return Err(wrong(path, at, other.text(), expected));
            }
        }
    }
    let at = solids[0].1;
    let solids: Vec<Solid> = solids.into_iter().map(|(solid, _)| solid).collect();
    let root = parser.builder.union(&solids, at)?;
    parser.builder.finish(text, root, bounds, unit)
}

struct Parser<'a> {
    path: &'a Path,
    lexer: Lexer<'a>,
    builder: Builder<'a>,
    names: HashMap<&'a str, Solid>,
}

impl<'a> Parser<'a> {
    /// Consumes a required sign.
    fn sign(&mut self, sign: char) -> Result<()> {
        let (token, at) = self.lexer.next()?;
        if token == Token::Sign(sign) {
            return Ok(());
        }
        Err(wrong(self.path, at, token.text(), format!("`{sign}`")))
    }

    /// Consumes the semicolon after a statement. It may be missing at the end of the text, except
    /// after `let`.
    fn statement_end(&mut self, statement: &Statement<'_>) -> Result<()> {
        match (self.lexer.next()?, statement) {
            ((Token::Sign(';'), _), _) | ((Token::End, _), Statement::Solid) => Ok(()),
            ((token, at), Statement::Let(name)) => {
                let expected = format!("`;` after the definition of `{name}`, and then a solid");
                Err(wrong(self.path, at, token.text(), expected))
            }
            ((token, at), Statement::Solid) => Err(wrong(self.path, at, token.text(), "`;`")),
        }
    }

    /// Consumes a name that is not yet defined.
    fn new_name(&mut self) -> Result<&'a str> {
        let (token, at) = self.lexer.next()?;
        let Token::Name(name) = token else {
            return Err(wrong(self.path, at, token.text(), "a name"));
        };
        if words::is_word(name) || ["let", "bounds", "unit"].contains(&name) {
            return Err(wrong(self.path, at, token.text(), "a name that is not a keyword"));
        }
        if self.names.contains_key(name) {
            let expected = "another name: this one is already defined";
            return Err(wrong(self.path, at, token.text(), expected));
        }
        Ok(name)
    }

    /// Consumes a unit in parentheses.
    fn unit(&mut self) -> Result<String> {
        self.sign('(')?;
        let (token, at) = self.lexer.next()?;
        let units = ["mm", "cm", "m", "km", "in", "ft"];
        let unit = units.iter().find(|unit| token == Token::Name(unit));
        let unit = unit.ok_or_else(|| wrong(self.path, at, token.text(), "mm, cm, m, km, in or ft"))?;
        self.sign(')')?;
        Ok(unit.to_string())
    }

    /// Consumes a solid.
    fn solid(&mut self) -> Result<(Solid, At)> {
        match self.lexer.next()? {
            (Token::Name(word), at) => Ok((self.solid_of(word, at)?, at)),
            (token, at) => Err(wrong(self.path, at, token.text(), "a solid")),
        }
    }

    /// Returns the solid of a name.
    fn named(&self, name: &str, at: At) -> Result<Solid> {
        if let Some(solid) = self.names.get(name) {
            return Ok(*solid);
        }
        let found = Token::Name(name).text();
        if words::is_word(name) {
            return Err(wrong(self.path, at, found, format!("`{name}(`, with its arguments")));
        }
        Err(wrong(self.path, at, found, words::instead_of(name)))
    }

    /// Consumes arguments that consist of numbers only, after the opening parenthesis.
    fn numbers_of(&mut self, word: &'a str, at: At) -> Result<Arguments<'a>> {
        let mut arguments = Vec::new();
        loop {
            match self.lexer.next()? {
                (Token::Sign(')'), end) => {
                    return Ok(Arguments::new(self.path, word, at, end, arguments));
                }
                (Token::Sign(','), _) if !arguments.is_empty() => {}
                (Token::Number(number), at) => arguments.push((Argument::Number(number), at)),
                (Token::Sign('['), at) => arguments.push((self.list(at)?, at)),
                (token, at) => return Err(wrong(self.path, at, token.text(), "a number")),
            }
        }
    }

    /// Consumes the solid that begins with a name.
    fn solid_of(&mut self, word: &'a str, at: At) -> Result<Solid> {
        let (mut word, mut at) = (word, at);
        let mut calls: Vec<Call<'a>> = Vec::new();
        loop {
            // `word` is a name. Without a parenthesis after it, it is a complete solid.
            let mut needs_comma = !words::is_word(word);
            if words::is_word(word) {
                let (token, token_at) = self.lexer.next()?;
                if token != Token::Sign('(') {
                    return Err(wrong(self.path, token_at, token.text(), format!("`(` after {word}")));
                }
                if calls.len() == MAX_DEPTH {
                    let found = format!("{} nested calls", MAX_DEPTH + 1);
                    let expected = format!("at most {MAX_DEPTH}; name parts with let");
                    return Err(wrong(self.path, at, found, expected));
                }
                calls.push(Call { word, at, arguments: Vec::new() });
            } else {
                let solid = self.named(word, at)?;
                match calls.last_mut() {
                    None => return Ok(solid),
                    Some(call) => call.arguments.push((Argument::Solid(solid), at)),
                }
            }
            // Arguments of the innermost call, up to the next name.
            loop {
                let (token, token_at) = self.lexer.next()?;
                let Some(call) = calls.last_mut() else {
                    unreachable!("without an open call, the solid was returned")
                };
                match token {
                    Token::Sign(')') => {
                        let Some(Call { word, at, arguments }) = calls.pop() else {
                            unreachable!("see above")
                        };
                        let arguments = Arguments::new(self.path, word, at, token_at, arguments);
                        let solid = words::call(&mut self.builder, arguments)?;
                        match calls.last_mut() {
                            None => return Ok(solid),
                            Some(call) => call.arguments.push((Argument::Solid(solid), at)),
                        }
                        needs_comma = true;
                    }
                    Token::Sign(',') if needs_comma => needs_comma = false,
                    _ if needs_comma => {
                        let expected = format!("`,` or `)` after an argument of {}", call.word);
                        return Err(wrong(self.path, token_at, token.text(), expected));
                    }
                    Token::Number(number) => {
                        call.arguments.push((Argument::Number(number), token_at));
                        needs_comma = true;
                    }
                    Token::Sign('[') => {
                        call.arguments.push((self.list(token_at)?, token_at));
                        needs_comma = true;
                    }
                    Token::Name(name) => {
                        (word, at) = (name, token_at);
                        break;
                    }
                    _ => {
                        let expected = format!("{}, or `)`", words::usage(call.word));
                        return Err(wrong(self.path, token_at, token.text(), expected));
                    }
                }
            }
        }
    }

    /// Consumes a list after its opening bracket: numbers, or points of two or three numbers in
    /// brackets.
    fn list(&mut self, begin: At) -> Result<Argument> {
        let (mut numbers, mut points, mut space_points) = (Vec::new(), Vec::new(), Vec::new());
        loop {
            let (token, at) = self.lexer.next()?;
            match token {
                Token::Number(number) if points.is_empty() && space_points.is_empty() => numbers.push(number),
                Token::Sign('[') if numbers.is_empty() => match self.point(at)? {
                    ([x, y], None) if space_points.is_empty() => points.push([x, y]),
                    ([x, y], Some(z)) if points.is_empty() => space_points.push([x, y, z]),
                    (_, z) => {
                        let [found, expected] = match z {
                            None => ["two", "three"],
                            Some(_) => ["three", "two"],
                        };
                        let found = format!("a point of {found} numbers");
                        return Err(wrong(self.path, at, found, format!("{expected}, as before")));
                    }
                },
                Token::Sign(']') => break,
                _ => {
                    let expected = "numbers, as in [1, 2, 3], or points of two or three numbers, as in [[0, 0], [1, 0], [0, 1]]";
                    return Err(wrong(self.path, at, token.text(), expected));
                }
            }
            match self.lexer.next()? {
                (Token::Sign(','), _) => {}
                (Token::Sign(']'), _) => break,
                (token, at) => return Err(wrong(self.path, at, token.text(), "`,` or `]`")),
            }
        }
        match (numbers.is_empty(), points.is_empty(), space_points.is_empty()) {
            (true, true, true) => Err(wrong(self.path, begin, "nothing in brackets", "numbers or points")),
            (false, ..) => Ok(Argument::Numbers(numbers)),
            (true, false, _) => Ok(Argument::Points(points)),
            (true, true, false) => Ok(Argument::SpacePoints(space_points)),
        }
    }

    /// Consumes two or three numbers after the opening bracket.
    fn point(&mut self, begin: At) -> Result<([f64; 2], Option<f64>)> {
        let mut numbers = Vec::new();
        loop {
            match self.lexer.next()? {
                (Token::Number(found), _) => numbers.push(found),
                (token, at) => {
                    let expected = format!("a number: the point at {begin} has two or three");
                    return Err(wrong(self.path, at, token.text(), expected));
                }
            }
            let (token, at) = self.lexer.next()?;
            match (token, &numbers[..]) {
                (Token::Sign(']'), [x, y]) => return Ok(([*x, *y], None)),
                (Token::Sign(']'), [x, y, z]) => return Ok(([*x, *y], Some(*z))),
                (Token::Sign(','), [_] | [_, _]) => {}
                _ => {
                    let sign = match numbers.len() {
                        1 => "`,`",
                        2 => "`,` or `]`",
                        _ => "`]`",
                    };
                    let expected = format!("{sign}: the point at {begin} has two or three numbers");
                    return Err(wrong(self.path, at, token.text(), expected));
                }
            }
        }
    }
}

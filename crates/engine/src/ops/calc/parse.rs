//! Expression parser: by operator precedence, of bounded depth, with postfix output.

use std::iter::Peekable;
use std::vec::IntoIter;

use super::expression::{Binary, Expression, MAX_STEPS, Name, Op, Reducer, Unary};
use spinney_base::{Error, Result};

/// Maximum length of an expression in bytes.
const MAX_BYTES: usize = 1 << 16;
/// Maximum nesting of parentheses, functions and signs.
const MAX_NESTING: usize = 64;

/// Parses an expression.
///
/// # Errors
/// If it is invalid, too long, or too deep; the message gives the position.
pub(super) fn parse(text: &str) -> Result<Expression> {
    if text.len() > MAX_BYTES {
        let found = format!("an expression of {} bytes", text.len());
        return Err(Error::invalid("calculation", found, format!("at most {MAX_BYTES} bytes")));
    }
    let tokens = tokens(text)?;
    let mut parser =
        Parser { text, tokens: tokens.into_iter().peekable(), names: Vec::new(), ops: Vec::new() };
    parser.expression(0, 0)?;
    match parser.tokens.next() {
        None => Expression::new(parser.names, parser.ops),
        Some((at, token)) => Err(wrong(text, at, format!("{}an operator", token.instead_of()))),
    }
}

/// Error for an unexpected token at a byte offset.
fn wrong(text: &str, at: usize, expected: impl AsRef<str>) -> Error {
    // (Long strings are shown from shortly before the offset.)
    let boundary = |at: usize| (at..text.len()).find(|at| text.is_char_boundary(*at)).unwrap_or(text.len());
    let (start, end) = (boundary(at.saturating_sub(30)), boundary(at + 30));
    let dots = |is_cut: bool| if is_cut { "..." } else { "" };
    let shown = &text[start..end];
    let found = format!(
        "`{}{shown}{}`, at character {}",
        dots(start > 0),
        dots(end < text.len()),
        text[..at].chars().count() + 1
    );
    Error::invalid("calculation", found, expected.as_ref())
}

#[derive(Clone, Debug, PartialEq)]
enum Token {
    Number(f64),
    Name(Name),
    /// Operator (also a word), parenthesis, or comma.
    Sign(&'static str),
}

impl Token {
    /// Phrase for an unexpected token.
    fn instead_of(&self) -> String {
        match self {
            Token::Number(_) => "before the number ".into(),
            Token::Name(name) => format!("before `{}` ", name.whole),
            Token::Sign(sign) => format!("in place of `{sign}` "),
        }
    }
}

/// Signs, the longer ones first.
const SIGNS: [&str; 16] =
    ["<=", ">=", "==", "!=", "&", "|", "<", ">", "+", "-", "*", "/", "(", ")", ",", "!"];

fn tokens(text: &str) -> Result<Vec<(usize, Token)>> {
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(first) = text[at..].chars().next() {
        let rest = &text[at..];
        let (length, token) = if first.is_whitespace() {
            at += first.len_utf8();
            continue;
        } else if first.is_ascii_digit() || first == '.' {
            number(rest).ok_or_else(|| wrong(text, at, "a number, such as 0.5 or 1e-3"))?
        } else if first == '"' || is_name_start(first) {
            name(rest).ok_or_else(|| wrong(text, at, "a name, or a name in double quotes"))?
        } else {
            let sign = SIGNS.into_iter().find(|sign| rest.starts_with(sign)).ok_or_else(|| {
                wrong(text, at, "numbers, names, + - * / < <= > >= == != & | ( ) and commas")
            })?;
            (sign.len(), Token::Sign(sign))
        };
        // (Tokens after the last instruction that fits are not checked.)
        if tokens.len() > 4 * MAX_STEPS {
            return Err(wrong(text, at, format!("at most {MAX_STEPS} operations")));
        }
        tokens.push((at, token));
        at += length;
    }
    Ok(tokens)
}

fn number(text: &str) -> Option<(usize, Token)> {
    let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
    let mut length = digits(text);
    if text[length..].starts_with('.') {
        length += 1 + digits(&text[length + 1..]);
    }
    if let Some(exponent) = text[length..].strip_prefix(['e', 'E']) {
        let sign = usize::from(exponent.starts_with(['+', '-']));
        match digits(&exponent[sign..]) {
            0 => return None,
            count => length += 1 + sign + count,
        }
    }
    // `2b` is not a number followed by a name.
    if text[length..].starts_with(|next| is_name_start(next) || next == '.') {
        return None;
    }
    let number = text[..length].parse().ok().filter(|number: &f64| number.is_finite())?;
    Some((length, Token::Number(number)))
}

fn is_name_start(character: char) -> bool {
    character.is_alphabetic() || character == '_'
}

/// Name, and that of a channel after a dot.
fn name(text: &str) -> Option<(usize, Token)> {
    let (mut length, whole) = part_of_name(text)?;
    let mut channel = None;
    if let Some(rest) = text[length..].strip_prefix('.') {
        let (more, name) = part_of_name(rest)?;
        length += 1 + more;
        channel = Some(name);
    }
    // (A quoted name is never an operator.)
    let sign = ["and", "or", "not"].into_iter().find(|word| *word == &text[..length]);
    Some((length, sign.map_or(Token::Name(Name { whole, channel }), Token::Sign)))
}

fn part_of_name(text: &str) -> Option<(usize, String)> {
    if text.starts_with('"') {
        return quoted(text).filter(|(_, name)| !name.is_empty());
    }
    let end = text.find(|next: char| !next.is_alphanumeric() && next != '_').unwrap_or(text.len());
    (text.starts_with(is_name_start)).then(|| (end, text[..end].into()))
}

/// Unquotes the string at the beginning of `text`, in which doubled quotes are literal; also
/// returns its length with quotes.
pub(super) fn quoted(text: &str) -> Option<(usize, String)> {
    let quote = text.chars().next()?;
    let (mut name, mut at) = (String::new(), quote.len_utf8());
    loop {
        let end = at + text[at..].find(quote)?;
        name.push_str(&text[at..end]);
        at = end + quote.len_utf8();
        if !text[at..].starts_with(quote) {
            return Some((at, name));
        }
        name.push(quote);
        at += quote.len_utf8();
    }
}

/// Precedence of operators, from the loosest.
const OR: u8 = 1;
const AND: u8 = 2;
const NOT: u8 = 3;
const COMPARISON: u8 = 4;
const SUM: u8 = 5;
const PRODUCT: u8 = 6;
const SIGN: u8 = 7;

fn infix(token: &Token) -> Option<(u8, Binary)> {
    let Token::Sign(sign) = token else { return None };
    Some(match *sign {
        "|" | "or" => (OR, Binary::Or),
        "&" | "and" => (AND, Binary::And),
        "<" => (COMPARISON, Binary::Less),
        "<=" => (COMPARISON, Binary::LessOrEqual),
        ">" => (COMPARISON, Binary::Greater),
        ">=" => (COMPARISON, Binary::GreaterOrEqual),
        "==" => (COMPARISON, Binary::Equal),
        "!=" => (COMPARISON, Binary::NotEqual),
        "+" => (SUM, Binary::Add),
        "-" => (SUM, Binary::Subtract),
        "*" => (PRODUCT, Binary::Multiply),
        "/" => (PRODUCT, Binary::Divide),
        _ => return None,
    })
}

struct Parser<'a> {
    text: &'a str,
    tokens: Peekable<IntoIter<(usize, Token)>>,
    names: Vec<Name>,
    ops: Vec<Op>,
}

impl Parser<'_> {
    fn wrong(&mut self, expected: &str) -> Error {
        let at = self.tokens.peek().map_or(self.text.len(), |(at, _)| *at);
        wrong(self.text, at, expected)
    }

    /// Consumes a sign, if it is next.
    fn take(&mut self, sign: &str) -> bool {
        self.tokens.next_if(|(_, token)| matches!(token, Token::Sign(next) if *next == sign)).is_some()
    }

    fn expect(&mut self, sign: &str) -> Result<()> {
        if self.take(sign) { Ok(()) } else { Err(self.wrong(&format!("`{sign}`"))) }
    }

    /// Parses an expression whose operators bind no looser than `least`. A chain of operators is a
    /// loop; only nested expressions recurse.
    fn expression(&mut self, least: u8, depth: usize) -> Result<()> {
        if depth > MAX_NESTING {
            return Err(self.wrong(&format!("at most {MAX_NESTING} nested parentheses, functions and signs")));
        }
        self.prefix(depth)?;
        let mut compared = false;
        while let Some((binding, operator)) = self.tokens.peek().and_then(|(_, token)| infix(token)) {
            if binding < least {
                break;
            }
            if binding == COMPARISON && compared {
                return Err(self.wrong("a single comparison: a < b and b < c, not a < b < c"));
            }
            compared = binding == COMPARISON;
            self.tokens.next();
            self.expression(binding + 1, depth + 1)?;
            self.ops.push(Op::Binary(operator));
        }
        Ok(())
    }

    fn prefix(&mut self, depth: usize) -> Result<()> {
        if self.take("-") {
            self.expression(SIGN, depth + 1)?;
            self.ops.push(Op::Unary(Unary::Negate));
            return Ok(());
        }
        if self.take("+") {
            return self.expression(SIGN, depth + 1);
        }
        for (sign, binding) in [("!", SIGN), ("not", NOT)] {
            if self.take(sign) {
                self.expression(binding, depth + 1)?;
                self.ops.push(Op::Unary(Unary::Not));
                return Ok(());
            }
        }
        if self.take("(") {
            self.expression(0, depth + 1)?;
            return self.expect(")");
        }
        match self.tokens.next_if(|(_, token)| !matches!(token, Token::Sign(_))) {
            Some((_, Token::Number(number))) => self.ops.push(Op::Number(number)),
            Some((at, Token::Name(name))) if self.take("(") => return self.function(at, &name, depth),
            Some((_, Token::Name(name))) => {
                let number = self.names.iter().position(|other| *other == name);
                let number = number.unwrap_or_else(|| {
                    self.names.push(name);
                    self.names.len() - 1
                });
                self.ops.push(Op::Operand(number));
            }
            _ => return Err(self.wrong("a number, a name or a parenthesis")),
        }
        Ok(())
    }

    /// Parses a function, from after its opening parenthesis.
    fn function(&mut self, at: usize, name: &Name, depth: usize) -> Result<()> {
        let (start, mut arguments) = (self.ops.len(), Vec::new());
        loop {
            arguments.push(self.ops.len());
            self.expression(0, depth + 1)?;
            if !self.take(",") {
                break;
            }
        }
        self.expect(")")?;
        let count = arguments.len();
        let name = name.whole.as_str();
        let op = match (name, count, Reducer::named(name)) {
            (_, _, Some(reducer)) => return self.reduce(reducer, start, &arguments),
            ("where", 3, _) => Op::Where,
            ("abs", 1, _) => Op::Unary(Unary::Abs),
            ("sqrt", 1, _) => Op::Unary(Unary::Sqrt),
            ("where", ..) => return Err(wrong(self.text, at, "where(condition, then, else)")),
            ("abs" | "sqrt", ..) => return Err(wrong(self.text, at, format!("one number: {name}(a)"))),
            _ => {
                let expected = "where, abs, sqrt, min, max, mean, median or count before a parenthesis";
                return Err(wrong(self.text, at, expected));
            }
        };
        self.ops.push(op);
        Ok(())
    }

    /// Moves those arguments of a reducer to the end that are the same for all cells.
    fn reduce(&mut self, reducer: Reducer, start: usize, arguments: &[usize]) -> Result<()> {
        let ops = self.ops.split_off(start);
        let ends = arguments[1..].iter().copied().chain([start + ops.len()]);
        let parts = arguments.iter().zip(ends).map(|(from, to)| &ops[from - start..to - start]);
        let is_constant = |part: &&[Op]| !part.iter().any(|op| matches!(op, Op::Operand(_)));
        let (constants, others): (Vec<&[Op]>, Vec<&[Op]>) = parts.partition(is_constant);
        self.ops.extend(others.iter().chain(&constants).flat_map(|part| part.iter()));
        // (If all arguments are constant, they are the operands.)
        let counts = if others.is_empty() { (constants.len(), 0) } else { (others.len(), constants.len()) };
        self.ops.push(Op::Reduce(reducer, counts.0, counts.1));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Operations by short names.
    fn shown(text: &str) -> String {
        let expression = parse(text).unwrap_or_else(|error| panic!("{text}: {error}"));
        let word = |op: &Op| match op {
            Op::Number(number) => number.to_string(),
            Op::Operand(number) => {
                let name = &expression.names()[*number];
                name.channel
                    .as_ref()
                    .map_or(name.whole.clone(), |channel| format!("{}.{channel}", name.whole))
            }
            Op::Unary(unary) => format!("{unary:?}"),
            Op::Binary(binary) => format!("{binary:?}"),
            Op::Where => "Where".into(),
            Op::Reduce(reducer, count, constants) => format!("{}/{count}+{constants}", reducer.name()),
        };
        expression.ops().iter().map(word).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn operators_bind_as_usual() {
        for (text, expected) in [
            ("(B08-B04)/(B08+B04)", "B08 B04 Subtract B08 B04 Add Divide"),
            ("a-b-c", "a b Subtract c Subtract"),
            ("a+b*-c", "a b c Negate Multiply Add"),
            ("-a*b", "a Negate b Multiply"),
            ("--a", "a Negate Negate"),
            ("a<1 & b>=2|!c", "a 1 Less b 2 GreaterOrEqual And c Not Or"),
            ("not a == b and c", "a b Equal Not c And"),
            ("where(a>.5, 1e2, sqrt(b))", "a 0.5 Greater 100 b Sqrt Where"),
            ("min(1, a, 2, b.red)", "a b.red 1 2 min/2+2"),
            ("max(1,2)", "1 2 max/2+0"),
            ("median(a)", "a median/1+0"),
            ("\"odd, name\".\"\"\"q\"\"\" + é1", "odd, name.\"q\" é1 Add"),
            ("where + not_a - \"and\"", "where not_a Add and Subtract"),
        ] {
            assert_eq!(shown(text), expected, "{text}");
        }
    }

    #[test]
    fn what_is_no_expression_says_where() {
        for (text, at, expected) in [
            ("", 1, "a number, a name"),
            ("a+", 3, "a number, a name"),
            ("a b", 3, "before `b` an operator"),
            ("(a", 3, "`)`"),
            ("a)", 2, "in place of `)`"),
            ("a<b<c", 4, "a single comparison"),
            ("2b", 1, "a number, such as"),
            ("1e", 1, "a number, such as"),
            ("1e999", 1, "a number, such as"),
            ("é#", 2, "numbers, names"),
            ("sin(a)", 1, "where, abs"),
            ("where(a,b)", 1, "where(condition"),
            ("abs(a,b)", 1, "one number"),
            ("a and or b", 7, "a number, a name or a parenthesis"),
            ("\"a", 1, "a name"),
            ("\"\"", 1, "a name"),
            ("a..b", 1, "a name"),
            ("min()", 5, "a number, a name"),
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(
                error.contains(&format!("character {at}")) && error.contains(expected),
                "{text}: {error}"
            );
        }
    }

    #[test]
    fn depth_and_length_are_bounded() {
        let nested = |count: usize| format!("{}a{}", "(".repeat(count), ")".repeat(count));
        assert!(parse(&nested(MAX_NESTING)).is_ok());
        for deep in [nested(1000), format!("{}a", "-".repeat(20_000)), format!("{}a", "abs(".repeat(10_000))]
        {
            assert!(parse(&deep).unwrap_err().to_string().contains("nested"));
        }
        // Chains are not deep.
        assert!(parse(&format!("a{}", "+b".repeat(4000))).is_ok());
        assert!(parse(&format!("a{}", "+b".repeat(5000))).unwrap_err().to_string().contains("at most 8192"));
        assert!(parse(&"a+".repeat(40_000)).unwrap_err().to_string().contains("bytes"));
        assert!(parse(&" ".repeat(60_000)).is_err());
    }
}

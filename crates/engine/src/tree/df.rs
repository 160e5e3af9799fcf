//! DF-expressions: a tree in depth-first order, one symbol per node.
//!
//! The literature writes quadtrees with `G` (grey), `B` (black) and `W` (white), octrees with `M`
//! (MIXED), `F` (FULL) and `V` (VOID). Leaves with other values are written as a digit, or in
//! brackets if they need more than one digit: `7`, `[12]`, `[255,0,0]`. Parentheses and white space
//! only group. The packed form has 2 bits per node.

use std::fmt::Write;

use spinney_base::space::Dimension;
use spinney_base::value::{Number, Rule, Value, ValueType};
use spinney_base::{Error, Result};

use super::memory::MemTree;
use super::source::{Child, NodeState, Source, no_children};
use spinney_base::TreeType;

/// State numbers of packed expressions.
const VOID: u8 = NodeState::Void as u8;
const LEAF: u8 = NodeState::Leaf as u8;
const INNER: u8 = NodeState::Inner as u8;

/// One node of an expression.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Symbol {
    Void,
    Leaf(Value),
    Inner,
}

/// Returns the letters for VOID, full LEAF and INNER.
fn letters(dimension: Dimension) -> [char; 3] {
    match dimension {
        Dimension::Quad => ['W', 'B', 'G'],
        Dimension::Oct => ['V', 'F', 'M'],
    }
}

/// Returns the expression of a tree as text; leaves of value `full` are `B` or `F`.
///
/// # Errors
/// If the source fails.
pub fn to_text(source: &MemTree, full: Option<Value>) -> Result<String> {
    let form = source.form;
    let [void, black, inner] = letters(form.dimension);
    let mut text = String::new();
    walk(source, &mut |symbol| match symbol {
        Symbol::Void => text.push(void),
        Symbol::Inner => text.push(inner),
        Symbol::Leaf(value) if full == Some(value) => text.push(black),
        Symbol::Leaf(value) => write_value(&mut text, form.value, value),
    })?;
    Ok(text)
}

/// Writes a leaf's value: a digit, or in brackets if it needs more than one digit.
pub fn write_value(text: &mut String, value_type: ValueType, value: Value) {
    let numbers = value_type.numbers(value);
    match numbers[..] {
        [n] if n.to_integer().is_some_and(|n| (0..10).contains(&n)) => {
            let _ = write!(text, "{n}");
        }
        _ => {
            let list: Vec<String> = numbers.iter().map(Number::to_string).collect();
            let _ = write!(text, "[{}]", list.join(","));
        }
    }
}

/// Returns the tree of a textual expression; `B` and `F` are leaves of value `full`. The result is
/// condensed, and its representatives follow `rule`.
///
/// # Errors
/// If the text has an unknown symbol, ends too early, continues after the end of the tree, or is
/// deeper than `depth`.
pub fn from_text(form: TreeType, text: &str, depth: u8, full: Value, rule: Rule) -> Result<MemTree> {
    let bad = |position: usize, found: &str, expected: &str| {
        Error::invalid(format!("DF-expression, byte {position}"), format!("`{found}`"), expected)
    };
    let mut symbols = Vec::new();
    let mut rest = text;
    while let Some(letter) = rest.chars().next() {
        let position = text.len() - rest.len();
        rest = &rest[letter.len_utf8()..];
        symbols.push(match letter {
            'W' | 'V' => Symbol::Void,
            'B' | 'F' => Symbol::Leaf(full),
            'G' | 'M' => Symbol::Inner,
            '(' | ')' => continue,
            _ if letter.is_whitespace() => continue,
            '[' => {
                let end = rest.find(']').ok_or_else(|| bad(position, rest, "a closing bracket"))?;
                let list = &rest[..end];
                rest = &rest[end + 1..];
                let value = parse_value(form.value, list);
                Symbol::Leaf(
                    value.ok_or_else(|| bad(position, list, &format!("a value of type {}", form.value)))?,
                )
            }
            _ => {
                let digit = letter.to_digit(10).and_then(|digit| form.value.splat(digit));
                Symbol::Leaf(digit.ok_or_else(|| {
                    bad(position, letter.encode_utf8(&mut [0; 4]), "one of G B W M F V, a digit, or [value]")
                })?)
            }
        });
    }
    assemble(form, &symbols, depth, rule)
}

/// Parses the value between brackets.
pub fn parse_value(value_type: ValueType, list: &str) -> Option<Value> {
    let numbers: Option<Vec<Number>> = list.split(',').map(|number| number.trim().parse().ok()).collect();
    let numbers = numbers?;
    // (NaN is not equal to any sample, but float samples can be NaN.)
    let sample = value_type.sample;
    let fits = |number: &Number| sample.can_hold(*number) || (sample.is_float() && number.is_nan());
    let is_one = numbers.len() == usize::from(value_type.channels) && numbers.iter().all(fits);
    is_one.then(|| value_type.nearest_numbers(|channel| numbers[channel]))
}

/// The packed expression of a tree.
#[derive(Clone, Debug, PartialEq)]
pub struct Packed {
    /// Two bits per symbol, the number of its [`NodeState`]; the first symbol is in the lowest bits
    /// of the first byte.
    pub bits: Vec<u8>,
    /// Number of symbols.
    pub symbols: usize,
    /// Values of the leaves, in order.
    pub values: Vec<Value>,
}

/// Returns the expression of a tree in 2 bits per node.
///
/// # Errors
/// If the source fails.
pub fn to_packed(source: &MemTree) -> Result<Packed> {
    let mut packed = Packed { bits: Vec::new(), symbols: 0, values: Vec::new() };
    walk(source, &mut |symbol| {
        let number = match symbol {
            Symbol::Void => VOID,
            Symbol::Leaf(value) => {
                packed.values.push(value);
                LEAF
            }
            Symbol::Inner => INNER,
        };
        if packed.symbols.is_multiple_of(4) {
            packed.bits.push(0);
        }
        packed.bits[packed.symbols / 4] |= number << (packed.symbols % 4 * 2);
        packed.symbols += 1;
    })?;
    Ok(packed)
}

/// Passes a tree's symbols to `symbol`, in order.
fn walk(source: &MemTree, symbol: &mut dyn FnMut(Symbol)) -> Result<()> {
    let mut pending = vec![source.root()?];
    let mut children = no_children();
    while let Some(child) = pending.pop() {
        match child {
            Child::Void => symbol(Symbol::Void),
            Child::Leaf(value) => symbol(Symbol::Leaf(value)),
            Child::Inner { node, .. } => {
                symbol(Symbol::Inner);
                source.children(&node, &mut children)?;
                pending.extend(children[..source.form.children()].iter().rev());
            }
        }
    }
    Ok(())
}

fn assemble(form: TreeType, symbols: &[Symbol], depth: u8, rule: Rule) -> Result<MemTree> {
    let most = form.dimension.max_depth();
    if depth > most {
        return Err(Error::invalid("depth", depth.to_string(), format!("at most {most}")));
    }
    // The tree as written, which is condensed afterwards.
    let mut expression = MemTree { form, depth, root: Child::Void, inner: Vec::new() };
    let mut next = 0;
    expression.root = read(&mut expression, symbols, &mut next, 0)?;
    if next < symbols.len() {
        let found = format!("{} symbols after the end of the tree", symbols.len() - next);
        return Err(Error::invalid("DF-expression", found, "one tree"));
    }
    MemTree::from_source(&expression, rule)
}

/// Parses the expression of one node, which starts at symbol `next`.
fn read(tree: &mut MemTree, symbols: &[Symbol], next: &mut usize, level: u8) -> Result<Child<usize>> {
    let symbol = symbols.get(*next).ok_or_else(|| {
        let found = format!("its end after symbol {}", symbols.len());
        Error::invalid("DF-expression", found, "children for every inner node")
    })?;
    *next += 1;
    Ok(match symbol {
        Symbol::Void => Child::Void,
        Symbol::Leaf(value) => Child::Leaf(*value),
        Symbol::Inner => {
            if level == tree.depth {
                let found = format!("an inner node at level {level} (symbol {next})");
                let expected = format!("a depth of at most {}", tree.depth);
                return Err(Error::invalid("DF-expression", found, expected));
            }
            let mut children = no_children();
            for child in &mut children[..tree.form.children()] {
                *child = read(tree, symbols, next, level + 1)?;
            }
            tree.inner.push(children);
            Child::Inner { representative: Value::ZERO, node: tree.inner.len() - 1 }
        }
    })
}

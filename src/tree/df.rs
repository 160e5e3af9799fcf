//! DF-expressions: a tree in depth-first order, one symbol per node.
//!
//! The literature writes quadtrees with `G` (grey), `B` (black) and `W` (white), octrees with `M` (MIXED), `F`
//! (FULL) and `V` (VOID). Leaves with other values are written as a digit, or in brackets where one digit does not
//! do: `7`, `[12]`, `[255,0,0]`. Round parentheses and white space only group. The packed form has 2 bits per node.

use std::fmt::Write;

use crate::space::{Dimension, Quad};
use crate::value::{Rule, Sample, Value};
use crate::{Error, Result};

use super::memory::MemTree;
use super::source::{Child, Source};

/// One node of an expression.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Symbol<V> {
    Void,
    Leaf(V),
    Inner,
}

/// Letters for VOID, full LEAF and INNER.
fn letters<D: Dimension>() -> [char; 3] {
    if D::AXES == Quad::AXES { ['W', 'B', 'G'] } else { ['V', 'F', 'M'] }
}

/// The expression of a tree as text; leaves of value `full` are `B` or `F`.
///
/// # Errors
/// If the source fails.
pub fn to_text<S: Source>(source: &S, full: Option<S::Value>) -> Result<String> {
    let [void, black, inner] = letters::<S::Dim>();
    let mut text = String::new();
    walk(source, |symbol| match symbol {
        Symbol::Void => text.push(void),
        Symbol::Inner => text.push(inner),
        Symbol::Leaf(value) if full.is_some_and(|full| full.same(value)) => text.push(black),
        Symbol::Leaf(value) => write_value(&mut text, value),
    })?;
    Ok(text)
}

fn write_value<V: Value>(text: &mut String, value: V) {
    let numbers: Vec<f64> = value.samples().iter().map(|sample| sample.to_f64()).collect();
    match numbers[..] {
        [n] if (0.0..10.0).contains(&n) && n.fract() == 0.0 && !n.is_sign_negative() => {
            let _ = write!(text, "{n}");
        }
        _ => {
            let list: Vec<String> = numbers.iter().map(f64::to_string).collect();
            let _ = write!(text, "[{}]", list.join(","));
        }
    }
}

/// The tree of a textual expression; `B` and `F` are leaves of value `full`. The result is condensed, and its
/// representatives follow `rule`.
///
/// # Errors
/// If the text has a symbol that is none, ends too early, goes on after the end, or is deeper than `depth`.
pub fn from_text<D: Dimension, V: Value>(
    text: &str,
    depth: u8,
    full: V,
    rule: Rule,
) -> Result<MemTree<D, V>> {
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
                let value = parse_value(list);
                Symbol::Leaf(
                    value.ok_or_else(|| bad(position, list, &format!("a value of type {}", V::TYPE)))?,
                )
            }
            _ => {
                let digit = letter.to_digit(10).and_then(|digit| V::splat_f64(digit as f64));
                Symbol::Leaf(digit.ok_or_else(|| {
                    bad(position, letter.encode_utf8(&mut [0; 4]), "one of G B W M F V, a digit, or [value]")
                })?)
            }
        });
    }
    assemble(&symbols, depth, rule)
}

fn parse_value<V: Value>(list: &str) -> Option<V> {
    let numbers: Option<Vec<V::Sample>> =
        list.split(',').map(|n| n.trim().parse().ok().and_then(V::Sample::from_f64)).collect();
    let numbers = numbers.filter(|numbers| numbers.len() == V::CHANNELS)?;
    Some(V::from_channels(|channel| numbers[channel]))
}

/// The packed expression of a tree.
#[derive(Clone, Debug, PartialEq)]
pub struct Packed<V> {
    /// Two bits per symbol, first symbol in the lowest bits of the first byte: 0 VOID, 1 LEAF, 2 INNER.
    pub bits: Vec<u8>,
    /// Number of symbols.
    pub symbols: usize,
    /// Values of the leaves, in order.
    pub values: Vec<V>,
}

/// The expression of a tree in 2 bits per node.
///
/// # Errors
/// If the source fails.
pub fn to_packed<S: Source>(source: &S) -> Result<Packed<S::Value>> {
    let mut packed = Packed { bits: Vec::new(), symbols: 0, values: Vec::new() };
    walk(source, |symbol| {
        let number = match symbol {
            Symbol::Void => 0,
            Symbol::Leaf(value) => {
                packed.values.push(value);
                1
            }
            Symbol::Inner => 2,
        };
        if packed.symbols % 4 == 0 {
            packed.bits.push(0);
        }
        packed.bits[packed.symbols / 4] |= number << (packed.symbols % 4 * 2);
        packed.symbols += 1;
    })?;
    Ok(packed)
}

/// The tree of a packed expression, condensed, with representatives by `rule`.
///
/// # Errors
/// If the bits or the values do not make one tree of at most `depth` levels.
pub fn from_packed<D: Dimension, V: Value>(
    packed: &Packed<V>,
    depth: u8,
    rule: Rule,
) -> Result<MemTree<D, V>> {
    let bad = |found: String, expected: &str| Error::invalid("packed DF-expression", found, expected);
    if packed.bits.len() != packed.symbols.div_ceil(4) {
        let found = format!("{} bytes for {} symbols", packed.bits.len(), packed.symbols);
        return Err(bad(found, "one byte per four symbols"));
    }
    let mut values = packed.values.iter();
    let symbols: Result<Vec<_>> = (0..packed.symbols)
        .map(|i| match packed.bits[i / 4] >> (i % 4 * 2) & 3 {
            0 => Ok(Symbol::Void),
            1 => values
                .next()
                .map(|value| Symbol::Leaf(*value))
                .ok_or_else(|| bad(format!("{} values", packed.values.len()), "a value for every leaf")),
            2 => Ok(Symbol::Inner),
            _ => Err(bad(format!("symbol 3 at {i}"), "0, 1 or 2")),
        })
        .collect();
    let symbols = symbols?;
    if values.next().is_some() {
        return Err(bad(format!("{} values", packed.values.len()), "no more values than leaves"));
    }
    assemble(&symbols, depth, rule)
}

/// Hands out a tree's symbols in order.
fn walk<S: Source>(source: &S, mut symbol: impl FnMut(Symbol<S::Value>)) -> Result<()> {
    let mut pending = vec![source.root()?];
    while let Some(place) = pending.pop() {
        match place {
            Child::Void => symbol(Symbol::Void),
            Child::Leaf(value) => symbol(Symbol::Leaf(value)),
            Child::Inner { node, .. } => {
                symbol(Symbol::Inner);
                let first = pending.len();
                pending.extend(source.children(&node)?);
                pending[first..].reverse();
            }
        }
    }
    Ok(())
}

fn assemble<D: Dimension, V: Value>(symbols: &[Symbol<V>], depth: u8, rule: Rule) -> Result<MemTree<D, V>> {
    if depth > D::MAX_DEPTH {
        return Err(Error::invalid("depth", depth.to_string(), format!("at most {}", D::MAX_DEPTH)));
    }
    // First as it is written, then condensed.
    let mut expression = MemTree::<D, V> { depth, root: Child::Void, inner: Vec::new() };
    let mut place = 0;
    expression.root = read(&mut expression, symbols, &mut place, 0)?;
    if place < symbols.len() {
        let found = format!("{} more symbols after the tree's end", symbols.len() - place);
        return Err(Error::invalid("DF-expression", found, "one tree"));
    }
    MemTree::from_source(&expression, rule)
}

/// Reads the expression of one node.
fn read<D: Dimension, V: Value>(
    tree: &mut MemTree<D, V>,
    symbols: &[Symbol<V>],
    place: &mut usize,
    level: u8,
) -> Result<Child<V, usize>> {
    let symbol = symbols.get(*place).ok_or_else(|| {
        let found = format!("its end after {} symbols", symbols.len());
        Error::invalid("DF-expression", found, "children for every inner node")
    })?;
    *place += 1;
    Ok(match symbol {
        Symbol::Void => Child::Void,
        Symbol::Leaf(value) => Child::Leaf(*value),
        Symbol::Inner => {
            if level == tree.depth {
                let found = format!("an inner node at level {level} (symbol {place})");
                let expected = format!("a depth of at most {}", tree.depth);
                return Err(Error::invalid("DF-expression", found, expected));
            }
            let mut children = D::array(|_| Child::Void);
            for child in children.as_mut() {
                *child = read(tree, symbols, place, level + 1)?;
            }
            tree.inner.push(children);
            Child::Inner { representative: V::default(), node: tree.inner.len() - 1 }
        }
    })
}

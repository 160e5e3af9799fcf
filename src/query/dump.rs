//! Small trees in full, as text.

use std::fmt::Write;

use crate::Result;
use crate::space::{Code, Dimension};
use crate::tree::{Child, MemTree, Source};
use crate::value::{Sample, Value};

/// The literature's table of a Goblin tree: a line per record with its number (from 1, in preorder), the children's
/// values, and the number of the record to go on with when this one's detail is skipped.
///
/// A representative has a minus sign as in the literature if all values are greater than zero, and stands in
/// parentheses otherwise; `.` is VOID.
///
/// # Errors
/// None for a tree in memory.
pub(crate) fn classic_table<D: Dimension, V: Value>(tree: &MemTree<D, V>) -> Result<String> {
    let mut rows = Vec::new();
    let mut positive = true;
    if let Child::Inner { node, .. } = tree.root()? {
        number(tree, node, &mut rows, &mut positive)?;
    }
    let mut text = String::new();
    for (i, (children, link)) in rows.iter().enumerate() {
        let _ = write!(text, "{:>6}", i + 1);
        for child in children {
            let value = child.value().map(|value| show(value)).unwrap_or_default();
            let cell = match child {
                Child::Void => ".".to_string(),
                Child::Leaf(_) => value,
                Child::Inner { .. } if positive => format!("-{value}"),
                Child::Inner { .. } => format!("({value})"),
            };
            let _ = write!(text, " {cell:>6}");
        }
        let _ = writeln!(text, " {link:>8}");
    }
    Ok(text)
}

type Row<V> = (Vec<Child<V, usize>>, usize);

fn number<D: Dimension, V: Value>(
    tree: &MemTree<D, V>,
    node: usize,
    rows: &mut Vec<Row<V>>,
    positive: &mut bool,
) -> Result<()> {
    let place = rows.len();
    let children = tree.children(&node)?.as_ref().to_vec();
    rows.push((children.clone(), 0));
    for child in children {
        *positive &= V::CHANNELS == 1 && child.value().is_none_or(|value| value.samples()[0].to_f64() > 0.0);
        if let Child::Inner { node, .. } = child {
            number(tree, node, rows, positive)?;
        }
    }
    rows[place].1 = rows.len() + 1;
    Ok(())
}

/// The literature's table of an Autumnal tree: a line per record with its number (from 1, in preorder), the children's values
/// or the numbers of their records, and the node's representative.
///
/// A value has a minus sign as in the literature if all are greater than zero, and stands in parentheses otherwise; `.` is
/// VOID.
///
/// # Errors
/// None for a tree in memory.
pub(crate) fn classic_pointer_table<D: Dimension, V: Value>(tree: &MemTree<D, V>) -> Result<String> {
    let mut rows = Vec::new();
    let mut positive = true;
    let root = tree.root()?;
    if let Child::Inner { node, .. } = root {
        number(tree, node, &mut rows, &mut positive)?;
    }
    let mut representatives = vec![root.value().unwrap_or_default(); rows.len()];
    let mut text = String::new();
    for (i, (children, _)) in rows.iter().enumerate() {
        let _ = write!(text, "{:>6}", i + 1);
        let mut next = i + 1;
        for child in children {
            let cell = match child {
                Child::Void => ".".to_string(),
                Child::Leaf(value) if positive => format!("-{}", show(*value)),
                Child::Leaf(value) => format!("({})", show(*value)),
                Child::Inner { representative, .. } => {
                    let below = next;
                    representatives[below] = *representative;
                    next = rows[below].1 - 1;
                    (below + 1).to_string()
                }
            };
            let _ = write!(text, " {cell:>6}");
        }
        let _ = writeln!(text, " {:>8}", show(representatives[i]));
    }
    Ok(text)
}

/// A line per leaf: FD code in digits, the code's integer, the value.
pub(crate) fn leaf_codes<S: Source>(source: &S) -> Result<String> {
    let mut text = String::new();
    let mut pending = vec![(Code::<S::Dim>::ROOT, source.root()?)];
    while let Some((code, place)) = pending.pop() {
        match place {
            Child::Void => {}
            Child::Leaf(value) => {
                let _ = writeln!(text, "{code} {} {}", code.bits(), show(value));
            }
            Child::Inner { node, .. } => {
                let children = source.children(&node)?;
                pending.extend(
                    children.as_ref().iter().enumerate().rev().map(|(i, c)| (code.child(i), c.clone())),
                );
            }
        }
    }
    Ok(text)
}

fn show<V: Value>(value: V) -> String {
    let samples: Vec<String> = value.samples().iter().map(|sample| sample.to_f64().to_string()).collect();
    samples.join(",")
}

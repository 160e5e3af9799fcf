//! Small trees in full, in text format.

use std::fmt::Write;

use crate::tree::{Child, MemTree, Source, no_children};
use spinney_base::Result;
use spinney_base::space::Code;
use spinney_base::value::{Number, Value, ValueType};

/// Returns the literature's table of a Goblin tree. It has a line per record: its number (from 1,
/// in preorder), the children's values, and the number of the record to continue with if this one's
/// detail is skipped.
///
/// A representative has a minus sign, as in the literature, if all values are greater than zero.
/// Otherwise it is in parentheses. `.` is VOID.
///
/// # Errors
/// None for a tree in memory.
pub fn classic_table(tree: &MemTree) -> Result<String> {
    let Numbered { rows, positive, .. } = Numbered::of(tree)?;
    let value_type = tree.form().value;
    let mut text = String::new();
    for (i, row) in rows.iter().enumerate() {
        let _ = write!(text, "{:>6}", i + 1);
        for child in &row.children {
            let value = child.value().map(|value| show(value_type, value)).unwrap_or_default();
            let cell = match child {
                Child::Void => ".".to_string(),
                Child::Leaf(_) => value,
                Child::Inner { .. } if positive => format!("-{value}"),
                Child::Inner { .. } => format!("({value})"),
            };
            let _ = write!(text, " {cell:>6}");
        }
        let _ = writeln!(text, " {:>8}", row.link);
    }
    Ok(text)
}

/// Returns the literature's table of an Autumnal tree. It has a line per record: its number (from
/// 1, in preorder), the children's values or the numbers of their records, and the node's
/// representative.
///
/// A value has a minus sign, as in the literature, if all values are greater than zero. Otherwise
/// it is in parentheses. `.` is VOID.
///
/// # Errors
/// None for a tree in memory.
pub(crate) fn classic_pointer_table(tree: &MemTree) -> Result<String> {
    let Numbered { rows, positive, .. } = Numbered::of(tree)?;
    let value_type = tree.form().value;
    // A record's representative is stored in its parent, which comes before it.
    let mut representatives = vec![tree.root()?.value().unwrap_or_default(); rows.len()];
    let mut text = String::new();
    for (i, row) in rows.iter().enumerate() {
        let _ = write!(text, "{:>6}", i + 1);
        let mut next = i + 1;
        for child in &row.children {
            let cell = match child {
                Child::Void => ".".to_string(),
                Child::Leaf(value) if positive => format!("-{}", show(value_type, *value)),
                Child::Leaf(value) => format!("({})", show(value_type, *value)),
                Child::Inner { representative, .. } => {
                    let below = next;
                    representatives[below] = *representative;
                    next = rows[below].link - 1;
                    (below + 1).to_string()
                }
            };
            let _ = write!(text, " {cell:>6}");
        }
        let _ = writeln!(text, " {:>8}", show(value_type, representatives[i]));
    }
    Ok(text)
}

/// The INNER nodes of a tree in preorder.
struct Numbered<'a> {
    tree: &'a MemTree,
    rows: Vec<Row>,
    /// Whether all values are greater than zero and have one channel.
    positive: bool,
}

/// An INNER node.
struct Row {
    children: Vec<Child<<MemTree as Source>::Node>>,
    /// Number, from 1, of the row after those of the node and its descendants.
    link: usize,
}

impl<'a> Numbered<'a> {
    fn of(tree: &'a MemTree) -> Result<Numbered<'a>> {
        let mut numbered = Numbered { tree, rows: Vec::new(), positive: true };
        if let Child::Inner { node, .. } = tree.root()? {
            numbered.add(&node)?;
        }
        Ok(numbered)
    }

    /// Adds an INNER node and its descendants.
    fn add(&mut self, node: &<MemTree as Source>::Node) -> Result<()> {
        let form = self.tree.form();
        let row = self.rows.len();
        let mut children = no_children();
        self.tree.children(node, &mut children)?;
        let children = &children[..form.children()];
        self.rows.push(Row { children: children.to_vec(), link: 0 });
        for child in children {
            let positive = child.value().is_none_or(|value| form.value.first_sample(value) > 0.0);
            self.positive &= form.value.channels == 1 && positive;
            if let Child::Inner { node, .. } = child {
                self.add(node)?;
            }
        }
        self.rows[row].link = self.rows.len() + 1;
        Ok(())
    }
}

/// Returns a line per leaf: the digits of its FD code, the code as an integer, and the value.
pub fn leaf_codes<S: Source>(source: &S) -> Result<String> {
    let form = source.form();
    let mut text = String::new();
    let mut pending = vec![(Code::root(form.dimension), source.root()?)];
    let mut children = no_children();
    while let Some((code, node)) = pending.pop() {
        match node {
            Child::Void => {}
            Child::Leaf(value) => {
                let _ = writeln!(text, "{code} {} {}", code.bits(), show(form.value, value));
            }
            Child::Inner { node, .. } => {
                source.children(&node, &mut children)?;
                // Reversed, so that the first child is popped next.
                let children = children[..form.children()].iter().enumerate().rev();
                pending.extend(children.map(|(i, child)| (code.child(i), child.clone())));
            }
        }
    }
    Ok(text)
}

fn show(value_type: ValueType, value: Value) -> String {
    let samples: Vec<String> = value_type.numbers(value).iter().map(Number::to_string).collect();
    samples.join(",")
}

//! Which values of one tree meet which of another: change matrices.

use std::cmp::Ordering;

use super::affine::{View, ViewNode};
use super::tree_file::check_form;
use crate::tree::{Child, Children, Source, no_children};
use crate::value::{Value, ValueType};
use crate::{Error, Result};

/// Cells in which a value of the first tree (`None` is VOID) meets one of the second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pair {
    /// The first tree's value.
    pub first: Option<Value>,
    /// The second tree's.
    pub second: Option<Value>,
    /// In so many cells.
    pub cells: u64,
}

/// Pairs that a table may have: elevations have no sensible table.
const MOST: usize = 1 << 16;

/// Counts all pairs of values but that of VOID with VOID, by ascending first, then second value; VOID comes first. Time is
/// proportional to the nodes of both trees.
///
/// # Errors
/// If forms or depths differ, there are more than 2^16 pairs, or a file is damaged.
pub fn cross(first: &View, second: &View) -> Result<Vec<Pair>> {
    let form = first.form();
    check_form((second.source().path(), second.form()), (first.source().path(), form))?;
    if first.depth() != second.depth() {
        let expected = format!("{}, as the first tree has", first.depth());
        return Err(Error::invalid("depth of a tree", second.depth().to_string(), expected));
    }
    let mut pairs = Pairs { value_type: form.value, pairs: Vec::new(), last: 0 };
    let (mut below_first, mut below_second) = (no_children(), no_children());
    let mut pending = vec![(first.depth(), first.root()?, second.root()?)];
    while let Some((height, a, b)) = pending.pop() {
        if height == 0 || !(a.is_inner() || b.is_inner()) {
            pairs.add(a.value(), b.value(), form.dimension.cells(height))?;
            continue;
        }
        children_of(first, &a, &mut below_first)?;
        children_of(second, &b, &mut below_second)?;
        let below = below_first.iter_mut().zip(&mut below_second).take(form.children());
        pending.extend(below.map(|(a, b)| (height - 1, std::mem::take(a), std::mem::take(b))));
    }
    Ok(pairs.pairs)
}

/// The children of a node; those of a uniform one are like it.
fn children_of(view: &View, child: &Child<ViewNode>, children: &mut Children<ViewNode>) -> Result<()> {
    match child {
        Child::Inner { node, .. } => view.children(node, children),
        uniform => {
            let value = uniform.value();
            children.iter_mut().for_each(|child| *child = Child::uniform(value));
            Ok(())
        }
    }
}

/// Pairs in their order; remembers the last one because neighbours are alike.
struct Pairs {
    value_type: ValueType,
    pairs: Vec<Pair>,
    last: usize,
}

impl Pairs {
    fn add(&mut self, a: Option<Value>, b: Option<Value>, cells: u64) -> Result<()> {
        if a.is_none() && b.is_none() {
            return Ok(());
        }
        let value_type = self.value_type;
        let order =
            |pair: &Pair| by_value(value_type, pair.first, a).then(by_value(value_type, pair.second, b));
        if !self.pairs.get(self.last).is_some_and(|pair| pair.first == a && pair.second == b) {
            self.last = match self.pairs.binary_search_by(order) {
                Ok(index) => index,
                Err(_) if self.pairs.len() == MOST => {
                    let found = format!("more than {MOST}");
                    let expected = "classes, of which there are few";
                    return Err(Error::invalid("pairs of values", found, expected));
                }
                Err(index) => {
                    self.pairs.insert(index, Pair { first: a, second: b, cells: 0 });
                    index
                }
            };
        }
        self.pairs[self.last].cells += cells;
        Ok(())
    }
}

/// VOID first, then by value.
fn by_value(value_type: ValueType, a: Option<Value>, b: Option<Value>) -> Ordering {
    match (a, b) {
        (Some(a), Some(b)) => value_type.order(a, b),
        _ => a.is_some().cmp(&b.is_some()),
    }
}

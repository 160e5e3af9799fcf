//! Cross tabulation of the values of two trees: change matrices.

use std::cmp::Ordering;
use std::collections::HashMap;

use super::affine::{View, ViewNode};
use crate::tree::{Child, Children, Source, no_children};
use spinney_base::value::{Value, ValueType};
use spinney_base::{Error, Progress, Result, sort};

/// Number of cells in which a value of the first tree (`None` is VOID) coincides with one of the
/// second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pair {
    /// Value in the first tree.
    pub first: Option<Value>,
    /// Value in the second tree.
    pub second: Option<Value>,
    /// Number of cells.
    pub cells: u64,
}

/// Maximum number of pairs in a table: elevations have no sensible table.
const MAX_PAIRS: usize = 1 << 16;

/// Counts all pairs of values except VOID with VOID, by ascending first, then second value; VOID
/// comes first. Time is proportional to the nodes of both trees.
///
/// # Errors
/// If depths differ, there are more than 2^16 pairs, a file is corrupt or was changed meanwhile, or
/// on cancellation.
pub fn crosstab(first: &View, second: &View, progress: &dyn Progress) -> Result<Vec<Pair>> {
    let form = first.form();
    if first.depth() != second.depth() {
        let expected = format!("{}, the depth of the first tree", first.depth());
        return Err(Error::invalid("depth of a tree", second.depth().to_string(), expected));
    }
    let mut pairs = Pairs::default();
    let (mut below_first, mut below_second) = (no_children(), no_children());
    let mut pending = vec![(first.depth(), first.root()?, second.root()?)];
    while let Some((height, a, b)) = pending.pop() {
        if height == 0 || !(a.is_inner() || b.is_inner()) {
            pairs.add((a.value(), b.value()), form.dimension.cells(height))?;
            continue;
        }
        progress.check()?;
        children_of(first, &a, &mut below_first)?;
        children_of(second, &b, &mut below_second)?;
        let below = below_first.iter_mut().zip(&mut below_second).take(form.children());
        pending.extend(below.map(|(a, b)| (height - 1, std::mem::take(a), std::mem::take(b))));
    }
    first.check_unchanged()?;
    second.check_unchanged()?;
    pairs.sorted(form.value, second.form().value)
}

/// Children of a node; those of a uniform node equal it.
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

/// Number of cells of each pair. Remembers the last pair, since neighbours are often equal.
#[derive(Default)]
struct Pairs {
    cells: HashMap<(Option<Value>, Option<Value>), u64>,
    last: (Option<Value>, Option<Value>),
    /// Cells of the last pair that are not in the table yet.
    run: u64,
}

impl Pairs {
    fn add(&mut self, pair: (Option<Value>, Option<Value>), cells: u64) -> Result<()> {
        if pair != self.last {
            self.end_run()?;
            self.last = pair;
        }
        self.run += cells;
        Ok(())
    }

    fn end_run(&mut self) -> Result<()> {
        let run = std::mem::take(&mut self.run);
        if self.last == (None, None) {
            return Ok(());
        }
        *self.cells.entry(self.last).or_default() += run;
        if self.cells.len() > MAX_PAIRS {
            let found = format!("more than {MAX_PAIRS}");
            return Err(Error::invalid("pairs of values", found, "trees with fewer classes"));
        }
        Ok(())
    }

    fn sorted(mut self, first: ValueType, second: ValueType) -> Result<Vec<Pair>> {
        self.end_run()?;
        let pairs = self.cells.into_iter().map(|((first, second), cells)| Pair { first, second, cells });
        let mut pairs: Vec<Pair> = pairs.collect();
        sort::by(&mut pairs, &mut |a, b| {
            by_value(first, a.first, b.first).then(by_value(second, a.second, b.second))
        });
        Ok(pairs)
    }
}

/// VOID first, then by value.
fn by_value(value_type: ValueType, a: Option<Value>, b: Option<Value>) -> Ordering {
    match (a, b) {
        (Some(a), Some(b)) => value_type.order(a, b),
        _ => a.is_some().cmp(&b.is_some()),
    }
}

//! Where two trees differ.

use std::path::Path;

use crate::space::{Code, Dimension};
use crate::store::goblin::{Layout, OpenOptions};
use crate::store::{File, Typed, typed};
use crate::tree::{Child, Source};
use crate::value::Value;
use crate::{Error, Result};

/// A block in which two trees differ, uniform in both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference<D: Dimension, V> {
    /// The node.
    pub code: Code<D>,
    /// The first tree's value; `None` is VOID.
    pub before: Option<V>,
    /// The second tree's.
    pub after: Option<V>,
}

/// Hands out all blocks in which two trees differ, in FD order. What two commits of one file have in common is not
/// looked at: time is proportional to what differs, plus depth for each place where something does.
///
/// # Errors
/// If depths differ, a source or `found` fails.
pub fn diff<A, B>(
    first: &A,
    second: &B,
    found: &mut impl FnMut(Difference<A::Dim, A::Value>) -> Result<()>,
) -> Result<()>
where
    A: Source,
    B: Source<Dim = A::Dim, Value = A::Value>,
{
    if first.depth() != second.depth() {
        let expected = format!("{}, as the first tree has", first.depth());
        return Err(Error::invalid("depth of a tree", second.depth().to_string(), expected));
    }
    node(first, second, Code::ROOT, first.root()?, second.root()?, found)
}

fn node<A, B>(
    first: &A,
    second: &B,
    code: Code<A::Dim>,
    a: Child<A::Value, A::Node>,
    b: Child<B::Value, B::Node>,
    found: &mut impl FnMut(Difference<A::Dim, A::Value>) -> Result<()>,
) -> Result<()>
where
    A: Source,
    B: Source<Dim = A::Dim, Value = A::Value>,
{
    let below = |code: Code<A::Dim>, step| code.child(step);
    match (a, b) {
        (Child::Void, Child::Void) => Ok(()),
        (Child::Leaf(a), Child::Leaf(b)) if a.same(b) => Ok(()),
        (Child::Inner { node: a, .. }, Child::Inner { node: b, .. }) => {
            if first.kept(&a).is_some_and(|kept| second.kept(&b) == Some(kept)) {
                return Ok(());
            }
            let pairs = first.children(&a)?.into_iter().zip(second.children(&b)?);
            let mut pairs = pairs.enumerate();
            pairs.try_for_each(|(step, (a, b))| node(first, second, below(code, step), a, b, found))
        }
        (Child::Inner { node: a, .. }, b) => {
            let mut children = first.children(&a)?.into_iter().enumerate();
            children.try_for_each(|(step, a)| node(first, second, below(code, step), a, b.clone(), found))
        }
        (a, Child::Inner { node: b, .. }) => {
            let mut children = second.children(&b)?.into_iter().enumerate();
            children.try_for_each(|(step, b)| node(first, second, below(code, step), a.clone(), b, found))
        }
        (a, b) => found(Difference { code, before: a.value(), after: b.value() }),
    }
}

/// What differs between two trees.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Differences {
    /// Cells that were VOID and are not any more.
    pub added: u64,
    /// Cells that have become VOID.
    pub removed: u64,
    /// Cells whose value is another one.
    pub changed: u64,
    /// Blocks in which they differ, uniform in both.
    pub blocks: u64,
}

/// A run of cells in FD order in which two trees differ, from one path to another: see
/// [`Code::path`](crate::space::Code::path).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FdRange {
    /// The first cell's path.
    pub first: u64,
    /// The last cell's.
    pub last: u64,
}

/// Compares two trees, or two commits of one; hands out the runs of cells that differ.
///
/// # Errors
/// If they cannot be read, are of different kinds, or `range` fails.
pub fn diff_files(
    first: &Path,
    second: &Path,
    range: &mut dyn FnMut(FdRange) -> Result<()>,
) -> Result<Differences> {
    typed(first, Diffing { paths: [first, second], range })
}

struct Diffing<'a> {
    paths: [&'a Path; 2],
    range: &'a mut dyn FnMut(FdRange) -> Result<()>,
}

impl Typed for Diffing<'_> {
    type Out = Differences;

    fn of<D: Layout, V: Value>(self) -> Result<Differences> {
        let [first, second] = self.paths;
        let open = |path| File::<D, V>::open(path, &OpenOptions::default());
        let (first, second) = (open(first)?, open(second)?);
        let depth = first.header().shape.depth;
        let mut sum = Differences::default();
        let mut run: Option<FdRange> = None;
        diff(&first, &second, &mut |found| {
            let bits = D::AXES * usize::from(depth - found.code.level());
            let cells = 1u64 << bits;
            match (found.before, found.after) {
                (None, _) => sum.added += cells,
                (_, None) => sum.removed += cells,
                _ => sum.changed += cells,
            }
            sum.blocks += 1;
            let block =
                FdRange { first: found.code.path() << bits, last: (found.code.path() << bits) + (cells - 1) };
            match &mut run {
                Some(run) if run.last + 1 == block.first => run.last = block.last,
                _ => run.replace(block).into_iter().try_for_each(&mut *self.range)?,
            }
            Ok(())
        })?;
        run.into_iter().try_for_each(self.range)?;
        Ok(sum)
    }
}

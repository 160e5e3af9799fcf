//! Differences between two trees.

use std::path::Path;

use super::tree_file::{TreeFile, TreeFileNode, check_form};
use crate::space::{Code, Crs};
use crate::store::OpenOptions;
use crate::store::builder::ReusableSource;
use crate::tree::{Child, Children, Source, no_children};
use crate::value::Value;
use crate::{Error, Result};

/// A block in which two trees differ, uniform in both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Difference {
    /// The node.
    pub code: Code,
    /// The first tree's value; `None` is VOID.
    pub before: Option<Value>,
    /// The second tree's.
    pub after: Option<Value>,
}

/// Hands out all blocks in which two trees differ, in FD order. Records that two commits of one file
/// share are not read: time is proportional to the nodes that differ, plus depth for each of them.
///
/// # Errors
/// If forms or depths differ, a file is damaged, or `found` fails.
pub fn diff(
    first: &TreeFile,
    second: &TreeFile,
    found: &mut dyn FnMut(Difference) -> Result<()>,
) -> Result<()> {
    check_form((second.path(), second.form()), (first.path(), first.form()))?;
    if first.depth() != second.depth() {
        let expected = format!("{}, as the first tree has", first.depth());
        return Err(Error::invalid("depth of a tree", second.depth().to_string(), expected));
    }
    let children = first.form().children();
    let root = Code::root(first.form().dimension);
    Comparison { first, second, children, found }.node(root, &first.root()?, &second.root()?)
}

/// Two trees that are walked side by side.
struct Comparison<'a> {
    first: &'a TreeFile,
    second: &'a TreeFile,
    /// Children of a node.
    children: usize,
    found: &'a mut dyn FnMut(Difference) -> Result<()>,
}

impl Comparison<'_> {
    fn node(&mut self, code: Code, a: &Child<TreeFileNode>, b: &Child<TreeFileNode>) -> Result<()> {
        match (a, b) {
            (Child::Void, Child::Void) => return Ok(()),
            (Child::Leaf(a), Child::Leaf(b)) if a == b => return Ok(()),
            (Child::Inner { node: a, .. }, Child::Inner { node: b, .. }) => {
                let record = self.first.kept(a);
                if record.is_some() && record == self.second.kept(b) {
                    return Ok(());
                }
            }
            (Child::Inner { .. }, _) | (_, Child::Inner { .. }) => {}
            (a, b) => return (self.found)(Difference { code, before: a.value(), after: b.value() }),
        }
        let (mut below_a, mut below_b) = (no_children(), no_children());
        let from_a = children_of(self.first, a, &mut below_a)?;
        let from_b = children_of(self.second, b, &mut below_b)?;
        for step in 0..self.children {
            let a = from_a.map_or(a, |below| &below[step]);
            let b = from_b.map_or(b, |below| &below[step]);
            self.node(code.child(step), a, b)?;
        }
        Ok(())
    }
}

/// The children of a node; `None` if it is uniform, and they are all like it.
fn children_of<'c>(
    file: &TreeFile,
    child: &Child<TreeFileNode>,
    children: &'c mut Children<TreeFileNode>,
) -> Result<Option<&'c Children<TreeFileNode>>> {
    let Child::Inner { node, .. } = child else { return Ok(None) };
    file.children(node, children)?;
    Ok(Some(children))
}

/// Totals of the differences between two trees.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
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
/// ```
/// let [first, second] = ["fixtures/v1/history.autumn@1", "fixtures/v1/history.autumn@2"];
/// let differences = spinney::ops::diff_files(first.as_ref(), second.as_ref(), &mut |_| Ok(()))?;
/// assert_eq!(differences.blocks, 9);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If they cannot be read, are of different forms or in different coordinate systems, or `range` fails.
pub fn diff_files(
    first: &Path,
    second: &Path,
    range: &mut dyn FnMut(FdRange) -> Result<()>,
) -> Result<Differences> {
    let options = OpenOptions::default();
    let (first, second) = (TreeFile::open(first, &options)?, TreeFile::open(second, &options)?);
    let [here, there] = [&first, &second].map(|file| file.path().display().to_string());
    let [a, b] = [&first, &second].map(|file| file.metadata().frame.crs.as_ref());
    Crs::check_same((&here, a), (&there, b))?;
    let (axes, depth) = (first.form().axes(), first.depth());
    let mut sum = Differences::default();
    let mut run: Option<FdRange> = None;
    diff(&first, &second, &mut |found| {
        let bits = axes * usize::from(depth - found.code.level());
        let cells = 1u64 << bits;
        match (found.before, found.after) {
            (None, _) => sum.added += cells,
            (_, None) => sum.removed += cells,
            _ => sum.changed += cells,
        }
        sum.blocks += 1;
        let path = found.code.path() << bits;
        let block = FdRange { first: path, last: path + (cells - 1) };
        match &mut run {
            Some(run) if run.last + 1 == block.first => run.last = block.last,
            _ => run.replace(block).into_iter().try_for_each(&mut *range)?,
        }
        Ok(())
    })?;
    run.into_iter().try_for_each(range)?;
    first.check_unchanged()?;
    second.check_unchanged()?;
    Ok(sum)
}

//! Differences between two trees.

use std::path::Path;

use super::affine::{View, ViewNode};
use super::reconcile::{Conversion, Needs, ReconcileOptions, Target, reconcile};
use super::tree_file::{TreeFile, TreeFileNode};
use super::view_source::check_form;
use crate::store::autumnal::{self, Remembered};
use crate::store::builder::ReusableSource;
use crate::tree::{Child, Children, Source, no_children};
use spinney_base::io::FileAccess;
use spinney_base::space::{Code, Dimension};
use spinney_base::value::Value;
use spinney_base::{Error, Progress, Result, TreeType};

/// Block in which two trees differ, uniform in both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Difference {
    /// The node.
    pub code: Code,
    /// Value in the first tree; `None` is VOID.
    pub before: Option<Value>,
    /// Value in the second tree.
    pub after: Option<Value>,
}

/// Yields all blocks in which two trees differ, in FD order. Records that two commits of a file
/// share are not read: time is proportional to the nodes that differ, plus depth for each of them.
///
/// # Errors
/// If tree types or depths differ, a file is corrupt, `found` fails, or on cancellation.
pub fn diff(
    first: &View,
    second: &View,
    progress: &dyn Progress,
    found: &mut dyn FnMut(Difference) -> Result<()>,
) -> Result<()> {
    check_alike(
        (first.source().name(), first.form(), first.depth()),
        (second.source().name(), second.form(), second.depth()),
    )?;
    let children = first.form().children();
    let root = Code::root(first.form().dimension);
    Comparison { first, second, children, progress, found }.node(root, &first.root()?, &second.root()?)
}

/// Yields the nodes of a level in which two trees differ, each once, in FD order; larger uniform
/// blocks are yielded as one node. The search below a node of that level stops at the first
/// difference: see [`diff`] for all of them.
///
/// # Errors
/// If tree types or depths differ, a file is corrupt, or `found` fails.
pub fn diff_nodes(
    first: &TreeFile,
    second: &TreeFile,
    level: u8,
    found: &mut dyn FnMut(Code) -> Result<()>,
) -> Result<()> {
    check_alike((first.path(), first.form(), first.depth()), (second.path(), second.form(), second.depth()))?;
    let children = first.form().children();
    let root = Code::root(first.form().dimension);
    let mut nodes = NodesThatDiffer { first, second, children, level, found };
    nodes.node(root, &first.root()?, &second.root()?).map(drop)
}

/// Fails if tree types or depths of two trees differ.
fn check_alike(first: (&Path, TreeType, u8), second: (&Path, TreeType, u8)) -> Result<()> {
    check_form((second.0, second.1), (first.0, first.1))?;
    if first.2 == second.2 {
        return Ok(());
    }
    let expected = format!("{}, the depth of the first tree", first.2);
    Err(Error::invalid("depth of a tree", second.2.to_string(), expected))
}

/// Two trees that are traversed in parallel.
struct Comparison<'a> {
    first: &'a View,
    second: &'a View,
    /// Children of a node.
    children: usize,
    progress: &'a dyn Progress,
    found: &'a mut dyn FnMut(Difference) -> Result<()>,
}

impl Comparison<'_> {
    fn node(&mut self, code: Code, a: &Child<ViewNode>, b: &Child<ViewNode>) -> Result<()> {
        match (a, b) {
            (Child::Void, Child::Void) => return Ok(()),
            (Child::Leaf(a), Child::Leaf(b)) if a == b => return Ok(()),
            (Child::Inner { .. }, _) | (_, Child::Inner { .. }) => {
                if is_same_record(self.first, a, self.second, b) {
                    return Ok(());
                }
            }
            (a, b) => return (self.found)(Difference { code, before: a.value(), after: b.value() }),
        }
        self.progress.check()?;
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

/// Two trees that are traversed in parallel, as deep as the nodes of a level require.
struct NodesThatDiffer<'a> {
    first: &'a TreeFile,
    second: &'a TreeFile,
    /// Children of a node.
    children: usize,
    level: u8,
    found: &'a mut dyn FnMut(Code) -> Result<()>,
}

impl NodesThatDiffer<'_> {
    /// Whether the trees differ in a node.
    fn node(&mut self, code: Code, a: &Child<TreeFileNode>, b: &Child<TreeFileNode>) -> Result<bool> {
        let mut differs = false;
        match (a, b) {
            (Child::Void, Child::Void) => return Ok(false),
            (Child::Leaf(a), Child::Leaf(b)) if a == b => return Ok(false),
            (Child::Inner { .. }, _) | (_, Child::Inner { .. }) => {
                if is_same_record(self.first, a, self.second, b) {
                    return Ok(false);
                }
                let (mut below_a, mut below_b) = (no_children(), no_children());
                let from_a = children_of(self.first, a, &mut below_a)?;
                let from_b = children_of(self.second, b, &mut below_b)?;
                for step in 0..self.children {
                    let a = from_a.map_or(a, |below| &below[step]);
                    let b = from_b.map_or(b, |below| &below[step]);
                    differs |= self.node(code.child(step), a, b)?;
                    if differs && code.level() >= self.level {
                        break;
                    }
                }
                if differs && code.level() == self.level {
                    (self.found)(code)?;
                }
            }
            _ => {
                differs = true;
                if code.level() <= self.level {
                    (self.found)(code)?;
                }
            }
        }
        Ok(differs)
    }
}

/// Whether two nodes are one record of one file.
pub(super) fn is_same_record<S: ReusableSource>(
    first: &S,
    a: &Child<S::Node>,
    second: &S,
    b: &Child<S::Node>,
) -> bool {
    let record = |file: &S, node: &Child<S::Node>| match node {
        Child::Inner { node, .. } => file.kept(node),
        _ => None,
    };
    record(first, a).is_some_and(|a| record(second, b) == Some(a))
}

/// Children of a node; `None` if it is uniform and all children equal it.
fn children_of<'c, S: Source>(
    file: &S,
    child: &Child<S::Node>,
    children: &'c mut Children<S::Node>,
) -> Result<Option<&'c Children<S::Node>>> {
    let Child::Inner { node, .. } = child else { return Ok(None) };
    file.children(node, children)?;
    Ok(Some(children))
}

/// Totals of the differences between two trees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Differences {
    /// Cells that were VOID and have a value now.
    pub added: u64,
    /// Cells that have become VOID.
    pub removed: u64,
    /// Cells whose value has changed.
    pub changed: u64,
    /// Blocks in which the trees differ, uniform in both.
    pub blocks: u64,
    /// Runs of cells in FD order in which the trees differ.
    pub runs: u64,
}

impl Differences {
    /// Counts a block of this number of cells.
    fn add(&mut self, before: Option<Value>, after: Option<Value>, cells: u64) {
        match (before, after) {
            (None, _) => self.added += cells,
            (_, None) => self.removed += cells,
            _ => self.changed += cells,
        }
        self.blocks += 1;
    }
}

/// Run of cells in FD order in which two trees differ, from one path to another: see
/// [`Code::path`](spinney_base::space::Code::path).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FdRange {
    /// Path of the first cell.
    pub first: u64,
    /// Path of the last cell.
    pub last: u64,
}

/// Compares two trees, or two commits of one, by their position in the world. Yields the runs of
/// cells that differ, by the FD codes of the grid that begins at [`CompareReport::origin`]. The
/// second tree is converted to the first one's cells and values before, as by
/// [`combine`](super::combine).
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::raw::ops::diff_files;
/// let [first, second] = ["fixtures/v1/history.autumn@1", "fixtures/v1/history.autumn@2"];
/// let report = diff_files(first.as_ref(), second.as_ref(), &Default::default(), &Default::default(), &(), &mut |_| Ok(()))?;
/// assert_eq!(report.differences.blocks, 9);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If they cannot be read or converted to one grid and type, `range` fails, or on cancellation.
pub fn diff_files(
    first: &Path,
    second: &Path,
    options: &ReconcileOptions,
    access: &FileAccess,
    progress: &dyn Progress,
    range: &mut dyn FnMut(FdRange) -> Result<()>,
) -> Result<CompareReport> {
    let (first, second, report) = open_both(first, second, options, access, progress)?;
    let differences = diff_views(&first, &second, progress, range)?;
    Ok(CompareReport { differences, ..report })
}

/// Totals of the differences between two views on one grid. Yields the runs of cells that differ.
fn diff_views(
    first: &View,
    second: &View,
    progress: &dyn Progress,
    range: &mut dyn FnMut(FdRange) -> Result<()>,
) -> Result<Differences> {
    let (axes, depth) = (first.form().axes(), first.depth());
    let mut sum = Differences::default();
    let mut run: Option<FdRange> = None;
    diff(first, second, progress, &mut |found| {
        let bits = axes * usize::from(depth - found.code.level());
        let cells = 1u64 << bits;
        sum.add(found.before, found.after, cells);
        let path = found.code.path() << bits;
        let block = FdRange { first: path, last: path + (cells - 1) };
        match &mut run {
            Some(run) if run.last + 1 == block.first => run.last = block.last,
            _ => {
                sum.runs += 1;
                run.replace(block).into_iter().try_for_each(&mut *range)?;
            }
        }
        Ok(())
    })?;
    run.into_iter().try_for_each(range)?;
    first.check_unchanged()?;
    second.check_unchanged()?;
    Ok(sum)
}

/// Differences of two trees, and how they were aligned.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CompareReport {
    /// Totals.
    pub differences: Differences,
    /// First cell of the grid on which both are compared, in cells of the first tree's grid.
    pub origin: [i64; 3],
    /// Conversions of the second tree.
    pub conversions: Vec<Conversion>,
}

/// Opens two trees as views on one grid, with values of the same meaning.
fn open_both(
    first: &Path,
    second: &Path,
    options: &ReconcileOptions,
    access: &FileAccess,
    progress: &dyn Progress,
) -> Result<(View, View, CompareReport)> {
    let open = |path: &Path| {
        let view = View::whole(TreeFile::open_only(path, &access.into())?.into())?;
        Ok((path.display().to_string(), view))
    };
    let reconciled =
        reconcile(vec![open(first)?, open(second)?], &|_| Needs::Values, options, Target::default())?;
    reconciled.warn_resampled(progress);
    let origin = reconciled.grid.shift(0).unwrap_or_default().map(|cells| -cells);
    let report = CompareReport { origin, conversions: reconciled.conversions, ..CompareReport::default() };
    let views = <[View; 2]>::try_from(reconciled.views);
    let [first, second] = views.unwrap_or_else(|_| unreachable!("two operands are two views"));
    Ok((first, second, report))
}

/// Compares two trees as [`diff_files`] does, for the totals only. A pair of records that occurs at
/// many nodes is compared once.
///
/// # Errors
/// Those of [`diff_files`].
pub fn differences(
    first: &Path,
    second: &Path,
    options: &ReconcileOptions,
    access: &FileAccess,
    progress: &dyn Progress,
) -> Result<CompareReport> {
    let (first_view, second_view, report) = open_both(first, second, options, access, progress)?;
    let as_they_are = (first_view.as_file(), second_view.as_file());
    let (Some(first_file), Some(second_file)) = as_they_are else {
        let differences = diff_views(&first_view, &second_view, progress, &mut |_| Ok(()))?;
        return Ok(CompareReport { differences, ..report });
    };
    let dimension = first_file.form().dimension;
    let known = Remembered::new(KNOWN_PAIRS);
    let mut totals = Totals { first: first_file, second: second_file, dimension, known, progress };
    let sum = totals.node(first_file.depth(), &first_file.any_root()?, &second_file.any_root()?)?.sum;
    first_file.check_unchanged()?;
    second_file.check_unchanged()?;
    Ok(CompareReport { differences: sum, ..report })
}

/// Bytes for the totals of pairs of nodes that were compared already.
const KNOWN_PAIRS: u64 = 32 << 20;

/// Height of the smallest nodes whose totals are remembered.
const KNOWN_HEIGHT: u8 = 4;

/// Pair of nodes of two trees that may occur again.
type Pair = [Side; 2];

/// Node of a tree.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum Side {
    Uniform(Option<Value>),
    /// Node of an Autumnal file.
    Inner(autumnal::AutumnalNode),
}

/// Totals of a run of cells in FD order.
#[derive(Clone, Copy, Default)]
struct RunDifferences {
    sum: Differences,
    /// Whether the trees differ in the first cell, and in the last.
    ends: [bool; 2],
}

impl RunDifferences {
    /// Concatenates this run and the next one.
    fn then(self, next: RunDifferences) -> RunDifferences {
        let (a, b) = (self.sum, next.sum);
        let joined = u64::from(self.ends[1] && next.ends[0]);
        let sum = Differences {
            added: a.added + b.added,
            removed: a.removed + b.removed,
            changed: a.changed + b.changed,
            blocks: a.blocks + b.blocks,
            runs: a.runs + b.runs - joined,
        };
        RunDifferences { sum, ends: [self.ends[0], next.ends[1]] }
    }
}

/// Two trees whose differences are counted.
struct Totals<'a> {
    first: &'a TreeFile,
    second: &'a TreeFile,
    dimension: Dimension,
    known: Remembered<Pair, RunDifferences>,
    progress: &'a dyn Progress,
}

impl Totals<'_> {
    /// Counts the differences at a node with `height` levels below it.
    fn node(
        &mut self,
        height: u8,
        a: &Child<TreeFileNode>,
        b: &Child<TreeFileNode>,
    ) -> Result<RunDifferences> {
        if !a.is_inner() && !b.is_inner() {
            let (a, b) = (a.value(), b.value());
            let mut sum = Differences::default();
            if a != b {
                sum.add(a, b, self.dimension.cells(height));
                sum.runs = 1;
            }
            return Ok(RunDifferences { sum, ends: [a != b; 2] });
        }
        let pair = Side::new(a).zip(Side::new(b)).map(<[Side; 2]>::from);
        // (Records of the two files may belong to nodes of different heights.)
        let pair = pair.filter(|pair| height >= KNOWN_HEIGHT && pair.iter().any(Side::has_record));
        if let Some(known) = pair.and_then(|pair| self.known.get(height, &pair)) {
            return Ok(*known);
        }
        let mut total: Option<RunDifferences> = None;
        if !is_same_record(self.first, a, self.second, b) {
            self.progress.check()?;
            let (mut below_a, mut below_b) = (no_children(), no_children());
            let from_a = children_of(self.first, a, &mut below_a)?;
            let from_b = children_of(self.second, b, &mut below_b)?;
            for step in 0..self.dimension.children() {
                let a = from_a.map_or(a, |below| &below[step]);
                let b = from_b.map_or(b, |below| &below[step]);
                let part = self.node(height - 1, a, b)?;
                total = Some(total.map_or(part, |total| total.then(part)));
            }
        }
        let total = total.unwrap_or_default();
        if let Some(pair) = pair {
            self.known.insert(height, pair, total, 0);
        }
        Ok(total)
    }
}

impl Side {
    /// Node of a tree; `None` if its file does not share equal subtrees.
    fn new(node: &Child<TreeFileNode>) -> Option<Side> {
        match node {
            Child::Inner { node: TreeFileNode::Autumnal(node), .. } => Some(Side::Inner(*node)),
            Child::Inner { .. } => None,
            uniform => Some(Side::Uniform(uniform.value())),
        }
    }

    fn has_record(&self) -> bool {
        matches!(self, Side::Inner(node) if node.has_record())
    }
}

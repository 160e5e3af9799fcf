//! Builds a tree file of either format from slabs of samples or from any source.

use super::builder::{BuildOptions, ReusableSource, Slabs};
use super::tree_target::TreeTarget;
use super::tree_writer::TreeWriter;
use crate::store::records::RecordLayout;
use crate::tree::{CellBlock, Child, Children, MemTree, Source};
use spinney_base::TreeType;
use spinney_base::io::Output;
use spinney_base::space::Code;
use spinney_base::value::{Value, ZoneStats};
use spinney_base::{Progress, Result};
use spinney_container::Metadata;

/// Builds a file from slabs of samples, in one pass; `nodata` is the value that means VOID (NaN
/// always does).
///
/// Uses all threads of the current rayon pool; the bytes written do not depend on their number.
/// Progress counts cells.
///
/// # Errors
/// If the input cannot be read, the output cannot be written, the extent does not fit the depth, or
/// on cancellation. No output is left then.
pub fn build_slabs(
    form: TreeType,
    slabs: &mut dyn Slabs,
    nodata: Option<Value>,
    options: &BuildOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<()> {
    let mut file = TreeWriter::create(output, (form.dimension, options.depth), 1)?;
    file.slabs(form, slabs, nodata, options, progress)?;
    file.finish()
}

/// Builds a file from any source.
///
/// `extent` is the raster's size in the header; cells outside must be VOID. Returns statistics of
/// all cells. If the source is stored in a file of the same rule, its records are copied unchanged.
///
/// # Errors
/// Those of [`build_slabs`].
pub fn build<S: ReusableSource>(
    source: &S,
    extent: [u64; 3],
    options: &BuildOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<ZoneStats> {
    build_with(source, extent, options, output.into(), progress, &mut |_| {})
}

/// Builds a file from any source whose nodes are identified by their codes: procedural solids, or
/// other spatial indexes. Memory is bounded as in [`build_slabs`], whatever the source's size.
///
/// ```
/// use spinney::{BuildOptions, Code, DataKind, Dimension, Output, SampleType, TreeType, Value, ValueType};
/// use spinney::tree::{Child, Children, Source, build_source};
///
/// /// A triangle: all cells whose column is less than their row.
/// struct Triangle;
///
/// impl Triangle {
///     fn node(&self, code: Code) -> Child<Code> {
///         let cells = code.bounds(self.depth());
///         if cells.max[0] <= cells.min[1] {
///             Child::Leaf(Value::from([255u8]))
///         } else if cells.min[0] + 1 >= cells.max[1] {
///             Child::Void
///         } else {
///             Child::Inner { representative: Value::from([255u8]), node: code }
///         }
///     }
/// }
///
/// impl Source for Triangle {
///     type Node = Code;
///
///     fn form(&self) -> TreeType {
///         TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1))
///     }
///     fn depth(&self) -> u8 {
///         10
///     }
///     fn root(&self) -> spinney::Result<Child<Code>> {
///         Ok(self.node(Code::root(Dimension::Quad)))
///     }
///     fn children(&self, node: &Code, children: &mut Children<Code>) -> spinney::Result<()> {
///         for (step, child) in children.iter_mut().take(4).enumerate() {
///             *child = self.node(node.child(step));
///         }
///         Ok(())
///     }
/// }
///
/// # fn main() -> spinney::Result<()> {
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("triangle.goblin");
/// let options = BuildOptions::new(DataKind::Continuous, 10);
/// let tally = build_source(&Triangle, [1024, 1024, 1], &options, Output::create(&path)?, &())?;
/// assert_eq!(tally.cells, 1024 * 1023 / 2);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// Those of [`build_slabs`]; also if the source fails.
pub fn build_source(
    source: &dyn Source<Node = Code>,
    extent: [u64; 3],
    options: &BuildOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<ZoneStats> {
    build(&CodedSource(source), extent, options, output, progress)
}

/// Checks that there is enough disk space for a tree of `records` INNER nodes, by an estimate.
///
/// # Errors
/// If there is not enough: see [`Output::check_space`].
pub fn check_space(output: &Output, form: TreeType, share: bool, records: u64) -> Result<()> {
    // If equal subtrees are stored once, the size cannot be estimated.
    let least = if share { 0 } else { RecordLayout::new(form).least_node() };
    output.check_space(records.saturating_mul(least))
}

/// A source of a library user, as a trait object, so that users do not compile the builder.
struct CodedSource<'a>(&'a dyn Source<Node = Code>);

impl Source for CodedSource<'_> {
    type Node = Code;

    fn form(&self) -> TreeType {
        self.0.form()
    }

    fn depth(&self) -> u8 {
        self.0.depth()
    }

    fn root(&self) -> Result<Child<Code>> {
        self.0.root()
    }

    fn children(&self, node: &Code, children: &mut Children<Code>) -> Result<()> {
        self.0.children(node, children)
    }

    fn cells(&self, node: &Code, levels: u8) -> Result<Option<CellBlock>> {
        self.0.cells(node, levels)
    }
}

impl ReusableSource for CodedSource<'_> {}

/// Builds a file from a tree in memory; for data that do not fit into memory, use [`build_slabs`].
///
/// # Errors
/// Those of [`build_slabs`].
pub fn build_tree(
    tree: &MemTree,
    extent: [u64; 3],
    options: &BuildOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<ZoneStats> {
    build(tree, extent, options, output, progress)
}

/// Builds a file, or a shard of one, as [`build`] does. `complete` can complete the metadata after
/// the source has been traversed.
///
/// # Errors
/// Those of [`build_slabs`].
pub fn build_with<S: ReusableSource>(
    source: &S,
    extent: [u64; 3],
    options: &BuildOptions,
    target: TreeTarget,
    progress: &dyn Progress,
    complete: &mut dyn FnMut(&mut Metadata),
) -> Result<ZoneStats> {
    let mut file = target.start((source.form().dimension, options.depth), 1)?;
    let tally = file.source_with(source, extent, options, progress, complete)?;
    file.finish()?;
    Ok(tally)
}

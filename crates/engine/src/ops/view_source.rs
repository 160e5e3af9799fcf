//! Sources that views read: a tree file, a file with uncommitted changes, a reprojected source, a
//! calculation, a source that is computed block by block, or a tree in memory.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use super::blockwise::Blockwise;
use super::calc::Calculated;
use super::coarse::{Coarse, CoarseNode};
use super::converted::Converted;
use super::patched::{Patched, PatchedNode};
use super::regions::Regions;
use super::tree_file::{TreeFile, TreeFileNode, other_node};
use super::warp::Warped;
use crate::query::{Canvas, Statistics, source_statistics};
use crate::store::autumnal::{Autumnal, Commit};
use crate::store::builder::{RecordRef, ReusableSource, StoredNode};
use crate::store::goblin::Goblin;
use crate::tree::{CellBlock, Child, Children, MemTree, Source, no_children};
use spinney_base::io::FileAccess;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{DataKind, Rule, Value, ZoneStats};
use spinney_base::{Error, Progress, Result, TreeType};
use spinney_container::{Codec, Header, Metadata, Shape};
use spinney_container::{HEAVY_THRESHOLD, STRIDE, reach};

/// Source with the header and metadata that its file would have.
pub enum ViewSource {
    /// File.
    File(TreeFile),
    /// Commit of a file with uncommitted changes.
    Patched(Patched),
    /// Small tree in memory.
    Memory(Box<MemoryTree>),
    /// Another source on the grid of another coordinate system.
    Warped(Box<Warped>),
    /// Calculation over the cells of other sources.
    Calculated(Box<Calculated>),
    /// Another source with converted values. Its nodes are those of that source.
    Converted(Box<Converted>),
    /// Level of a file.
    Coarse(Box<Coarse>),
    /// Connected components of another source's cells.
    Regions(Box<Regions>),
    /// Tree that is computed block by block.
    Blockwise(Box<Blockwise>),
}

/// An INNER node of a [`ViewSource`].
#[derive(Clone, Copy, Debug)]
pub enum ViewSourceNode {
    /// Node of a file.
    File(TreeFileNode),
    /// Node of a file with changes.
    Patched(PatchedNode),
    /// Node of a tree in memory.
    Memory(<MemTree as Source>::Node),
    /// Node of a reprojected source.
    Warped(Code),
    /// Node of a calculation.
    Calculated(Code),
    /// Node of a file's level.
    Coarse(CoarseNode),
    /// Node of connected components.
    Regions(Code),
    /// Node of a tree that is computed block by block.
    Blockwise(Code),
}

/// Tree in memory with the header and metadata that its file would have.
pub struct MemoryTree {
    tree: MemTree,
    header: Header,
    metadata: Metadata,
}

impl MemoryTree {
    /// Tree whose extent is its whole space, with averaged values and empty metadata.
    fn new(tree: MemTree) -> MemoryTree {
        let (form, depth) = (tree.form(), tree.depth());
        let header = Header {
            form,
            rule: Rule::Mean,
            kind: DataKind::Continuous,
            codec: Codec::Plain,
            shape: Shape {
                depth,
                reach: reach(form.dimension),
                stride: STRIDE,
                heavy_threshold: HEAVY_THRESHOLD,
            },
            extent: Bounds::space(form.dimension, depth).max,
        };
        MemoryTree { tree, header, metadata: Metadata::default() }
    }

    /// The tree.
    pub fn tree(&self) -> &MemTree {
        &self.tree
    }
}

impl ViewSource {
    /// Path of the underlying file; `None` for a tree in memory or a tree that is computed block by
    /// block.
    pub fn path(&self) -> Option<&Path> {
        match self {
            ViewSource::File(file) => Some(file.path()),
            ViewSource::Patched(tree) => Some(tree.file().path()),
            ViewSource::Warped(tree) => tree.source().path(),
            ViewSource::Calculated(tree) => tree.source().path(),
            ViewSource::Converted(tree) => tree.source().path(),
            ViewSource::Coarse(tree) => Some(tree.file().path()),
            ViewSource::Regions(tree) => tree.source().path(),
            ViewSource::Memory(_) | ViewSource::Blockwise(_) => None,
        }
    }

    /// How the underlying file was opened.
    pub fn access(&self) -> FileAccess {
        match self {
            ViewSource::File(file) => file.access().clone(),
            ViewSource::Patched(tree) => tree.file().access().clone(),
            ViewSource::Warped(tree) => tree.source().access(),
            ViewSource::Calculated(tree) => tree.source().access(),
            ViewSource::Converted(tree) => tree.source().access(),
            ViewSource::Coarse(tree) => tree.file().access().clone(),
            ViewSource::Regions(tree) => tree.source().access(),
            ViewSource::Memory(_) | ViewSource::Blockwise(_) => FileAccess::default(),
        }
    }

    /// Name for messages: the path, if there is one.
    pub fn name(&self) -> &Path {
        if let ViewSource::Blockwise(tree) = self {
            return tree.name();
        }
        self.path().unwrap_or(Path::new("a tree in memory"))
    }

    /// Underlying file, without changes on it; `None` if cells are computed.
    pub fn file(&self) -> Option<TreeFile> {
        match self {
            ViewSource::File(file) => Some(file.clone()),
            ViewSource::Patched(tree) => Some(tree.file().clone().into()),
            ViewSource::Memory(_)
            | ViewSource::Warped(_)
            | ViewSource::Calculated(_)
            | ViewSource::Converted(_)
            | ViewSource::Coarse(_)
            | ViewSource::Regions(_)
            | ViewSource::Blockwise(_) => None,
        }
    }

    /// Whether cells are computed, which takes longer than reading them.
    pub(crate) fn is_computed(&self) -> bool {
        match self {
            ViewSource::Warped(_)
            | ViewSource::Calculated(_)
            | ViewSource::Regions(_)
            | ViewSource::Blockwise(_) => true,
            ViewSource::Converted(tree) => tree.source().is_computed(),
            ViewSource::File(_) | ViewSource::Patched(_) | ViewSource::Memory(_) | ViewSource::Coarse(_) => {
                false
            }
        }
    }

    /// Whether levels above the cells are calculated from the values of these levels, not from the
    /// cells.
    pub(crate) fn is_approximate(&self) -> bool {
        match self {
            ViewSource::Calculated(tree) => tree.is_approximate(),
            ViewSource::Warped(tree) => tree.source().is_approximate(),
            ViewSource::Converted(tree) => tree.leaves_cells_out() || tree.source().is_approximate(),
            // (The builder makes the levels.)
            ViewSource::Regions(_) | ViewSource::Blockwise(_) => true,
            ViewSource::File(TreeFile::Mosaic(tree)) => tree.is_approximate(),
            ViewSource::File(_) | ViewSource::Patched(_) | ViewSource::Memory(_) | ViewSource::Coarse(_) => {
                false
            }
        }
    }

    /// Whether levels are drawn as a whole, not node by node. Representatives may then be left out.
    pub(crate) fn draws_levels(&self) -> bool {
        match self {
            ViewSource::Calculated(_) | ViewSource::File(TreeFile::Mosaic(_)) => true,
            ViewSource::Converted(tree) => tree.source().draws_levels(),
            _ => false,
        }
    }

    /// Representative of an INNER node, computed if it was left out.
    pub(super) fn representative(&self, node: &ViewSourceNode, given: Value) -> Result<Value> {
        match (self, node) {
            (ViewSource::File(file), ViewSourceNode::File(node)) => file.representative(node, given),
            (ViewSource::Converted(tree), node) => tree.representative(node, given),
            _ => Ok(given),
        }
    }

    /// Warning about the file for its reader: see [`Autumnal::remark`].
    pub fn remark(&self) -> Option<&'static str> {
        match self {
            ViewSource::File(file) => file.remark(),
            ViewSource::Patched(tree) => tree.file().remark(),
            ViewSource::Warped(tree) => tree.source().remark(),
            ViewSource::Calculated(tree) => tree.source().remark(),
            ViewSource::Converted(tree) => tree.source().remark(),
            ViewSource::Coarse(tree) => tree.file().remark(),
            ViewSource::Regions(tree) => tree.source().remark(),
            ViewSource::Memory(_) | ViewSource::Blockwise(_) => None,
        }
    }

    /// Reports the warnings about the source to `progress`, if there are any.
    pub(super) fn report_remark(&self, progress: &dyn Progress) {
        if let ViewSource::Regions(tree) = self {
            return tree.source().report_remark(progress);
        }
        if let ViewSource::Converted(tree) = self {
            return tree.source().report_remark(progress);
        }
        if let ViewSource::Calculated(tree) = self {
            tree.warn_of_remarks(progress);
            return tree.remarks().iter().for_each(|remark| progress.warn(self.name(), remark));
        }
        if let Some(remark) = self.remark() {
            progress.warn(self.name(), remark);
        }
        if let ViewSource::Warped(tree) = self {
            tree.remarks().iter().for_each(|remark| progress.warn(self.name(), remark));
        }
    }

    /// Header: tree type, rule, shape, extent.
    pub fn header(&self) -> &Header {
        match self {
            ViewSource::File(file) => file.header(),
            ViewSource::Patched(tree) => tree.file().header(),
            ViewSource::Memory(tree) => &tree.header,
            ViewSource::Warped(tree) => tree.header(),
            ViewSource::Calculated(tree) => tree.header(),
            ViewSource::Converted(tree) => tree.header(),
            ViewSource::Coarse(tree) => tree.header(),
            ViewSource::Regions(tree) => tree.header(),
            ViewSource::Blockwise(tree) => tree.header(),
        }
    }

    /// Metadata: frame, nodata, palette, names, provenance.
    pub fn metadata(&self) -> &Metadata {
        match self {
            ViewSource::File(file) => file.metadata(),
            ViewSource::Patched(tree) => tree.file().metadata(),
            ViewSource::Memory(tree) => &tree.metadata,
            ViewSource::Warped(tree) => tree.metadata(),
            ViewSource::Calculated(tree) => tree.metadata(),
            ViewSource::Converted(tree) => tree.metadata(),
            ViewSource::Coarse(tree) => tree.metadata(),
            ViewSource::Regions(tree) => tree.metadata(),
            ViewSource::Blockwise(tree) => tree.metadata(),
        }
    }

    /// Commit that is read; `None` for other sources than Autumnal files.
    pub fn commit(&self) -> Option<&Commit> {
        match self {
            ViewSource::File(file) => file.commit(),
            ViewSource::Patched(tree) => Some(tree.file().commit()),
            ViewSource::Memory(_)
            | ViewSource::Warped(_)
            | ViewSource::Calculated(_)
            | ViewSource::Converted(_)
            | ViewSource::Coarse(_)
            | ViewSource::Regions(_)
            | ViewSource::Blockwise(_) => None,
        }
    }

    /// Number of INNER nodes in trees whose records may be shared, so that few are stored: in
    /// Autumnal files all, else 0.
    pub(super) fn shared_records(&self) -> Result<u64> {
        match self {
            ViewSource::File(file) => file.shared_records(),
            ViewSource::Patched(tree) => tree.file().claimed_inner_nodes(),
            ViewSource::Converted(tree) => tree.source().shared_records(),
            ViewSource::Memory(_)
            | ViewSource::Warped(_)
            | ViewSource::Calculated(_)
            | ViewSource::Coarse(_)
            | ViewSource::Regions(_)
            | ViewSource::Blockwise(_) => Ok(0),
        }
    }

    /// Number of cells that are not VOID. For computed sources this is the number in their input; 0
    /// for trees that are computed block by block.
    pub(super) fn cells_before(&self) -> Result<u64> {
        match self {
            ViewSource::Calculated(tree) => tree.cells_before(),
            ViewSource::Converted(tree) => tree.source().cells_before(),
            ViewSource::Regions(tree) => tree.source().cells_before(),
            ViewSource::Coarse(tree) => ViewSource::from(tree.file().clone()).cells_before(),
            // (All blocks would have to be computed.)
            ViewSource::Blockwise(_) => Ok(0),
            _ => self.totals(None).map(|totals| totals.cells),
        }
    }

    /// Exact statistics of a box of cells (at the deepest level), without classes, since counting
    /// these may take longer. Without a box, of the whole extent; for a reprojected source, of the
    /// whole source before reprojection.
    ///
    /// # Errors
    /// If the file is corrupt there.
    pub fn totals(&self, bounds: Option<Bounds>) -> Result<Statistics> {
        let within = self.header().within_extent(bounds);
        match self {
            ViewSource::File(file) => file.statistics_with(&within, false, &()),
            // (All of its own cells would have to be computed.)
            ViewSource::Warped(tree) if bounds.is_none() => tree.source().totals(None),
            _ => source_statistics(self, &within, false, &()),
        }
    }

    /// Writes the children of an INNER node as nodes of a source that derives from this one.
    /// Equivalent to [`Source::children`], without a second array for sources with their own node
    /// type.
    pub(super) fn children_as<N>(
        &self,
        node: &ViewSourceNode,
        children: &mut Children<N>,
        node_of: impl Fn(ViewSourceNode) -> N,
    ) -> Result<()> {
        match (self, node) {
            (ViewSource::Converted(tree), node) => children_of(&**tree, node, children, node_of),
            (ViewSource::File(file), ViewSourceNode::File(node)) => {
                file.children_as(node, children, |node| node_of(ViewSourceNode::File(node)))
            }
            (ViewSource::Patched(tree), ViewSourceNode::Patched(node)) => {
                children_of(tree, node, children, |node| node_of(ViewSourceNode::Patched(node)))
            }
            (ViewSource::Memory(memory), ViewSourceNode::Memory(node)) => {
                children_of(&memory.tree, node, children, |node| node_of(ViewSourceNode::Memory(node)))
            }
            (ViewSource::Warped(tree), ViewSourceNode::Warped(node)) => {
                children_of(&**tree, node, children, |node| node_of(ViewSourceNode::Warped(node)))
            }
            (ViewSource::Calculated(tree), ViewSourceNode::Calculated(node)) => {
                children_of(&**tree, node, children, |node| node_of(ViewSourceNode::Calculated(node)))
            }
            (ViewSource::Coarse(tree), ViewSourceNode::Coarse(node)) => {
                children_of(&**tree, node, children, |node| node_of(ViewSourceNode::Coarse(node)))
            }
            (ViewSource::Regions(tree), ViewSourceNode::Regions(node)) => {
                children_of(&**tree, node, children, |node| node_of(ViewSourceNode::Regions(node)))
            }
            (ViewSource::Blockwise(tree), ViewSourceNode::Blockwise(node)) => {
                children_of(&**tree, node, children, |node| node_of(ViewSourceNode::Blockwise(node)))
            }
            _ => Err(other_node(self.name())),
        }
    }

    /// Reads a box of cells of a level inside the tree's space, as [`Source::draw`] does.
    ///
    /// # Errors
    /// If the file is corrupt there, or there is no such level.
    pub(super) fn draw_at(
        &self,
        level: u8,
        bounds: &Bounds,
        values: &mut [u8],
        valid: &mut [bool],
    ) -> Result<()> {
        match self {
            ViewSource::File(file) => file.draw_at(level, bounds, values, valid),
            ViewSource::Calculated(tree) => tree.draw_at(level, bounds, values, valid),
            ViewSource::Regions(tree) if level == tree.depth() => tree.draw_cells(bounds, values, valid),
            ViewSource::Converted(tree) => tree.draw_at(level, bounds, values, valid),
            _ => Canvas::new(self.form(), bounds, Value::ZERO, values, Some(valid))?.draw(
                self,
                self.root()?,
                level,
            ),
        }
    }
}

/// Fails unless both trees have the same type; the names are for the message.
pub(super) fn check_form(
    (name, form): (&Path, TreeType),
    (other, expected): (&Path, TreeType),
) -> Result<()> {
    // (Missing samples stay numbers here; the code that joins them with others interprets them.)
    if form.without_mask() == expected.without_mask() {
        return Ok(());
    }
    let expected = format!("{expected}, like {}", other.display());
    Err(Error::invalid(name.display().to_string(), form.to_string(), expected))
}

/// Writes the children of a source's node with another node type.
#[inline]
fn children_of<S: Source, N>(
    tree: &S,
    node: &S::Node,
    children: &mut Children<N>,
    node_of: impl Fn(S::Node) -> N,
) -> Result<()> {
    let mut found = no_children();
    tree.children(node, &mut found)?;
    for (child, found) in children.iter_mut().zip(found).take(tree.form().children()) {
        *child = found.map_node(&node_of);
    }
    Ok(())
}

impl From<TreeFile> for ViewSource {
    fn from(file: TreeFile) -> ViewSource {
        ViewSource::File(file)
    }
}

impl From<Goblin> for ViewSource {
    fn from(file: Goblin) -> ViewSource {
        TreeFile::from(file).into()
    }
}

impl From<Autumnal> for ViewSource {
    fn from(file: Autumnal) -> ViewSource {
        TreeFile::from(file).into()
    }
}

impl From<Arc<Autumnal>> for ViewSource {
    fn from(file: Arc<Autumnal>) -> ViewSource {
        TreeFile::from(file).into()
    }
}

impl From<Patched> for ViewSource {
    fn from(tree: Patched) -> ViewSource {
        ViewSource::Patched(tree)
    }
}

/// The tree's extent is its whole space; the metadata are empty.
impl From<MemTree> for ViewSource {
    fn from(tree: MemTree) -> ViewSource {
        ViewSource::Memory(Box::new(MemoryTree::new(tree)))
    }
}

impl From<Warped> for ViewSource {
    fn from(tree: Warped) -> ViewSource {
        ViewSource::Warped(Box::new(tree))
    }
}

impl From<Calculated> for ViewSource {
    fn from(tree: Calculated) -> ViewSource {
        ViewSource::Calculated(Box::new(tree))
    }
}

impl From<Blockwise> for ViewSource {
    fn from(tree: Blockwise) -> ViewSource {
        ViewSource::Blockwise(Box::new(tree))
    }
}

impl From<Regions> for ViewSource {
    fn from(tree: Regions) -> ViewSource {
        ViewSource::Regions(Box::new(tree))
    }
}

impl fmt::Debug for ViewSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("ViewSource").field(&self.name()).finish()
    }
}

impl Source for ViewSource {
    type Node = ViewSourceNode;

    fn form(&self) -> TreeType {
        self.header().form
    }

    fn depth(&self) -> u8 {
        self.header().depth()
    }

    fn root(&self) -> Result<Child<ViewSourceNode>> {
        Ok(match self {
            ViewSource::File(file) => file.root()?.map_node(ViewSourceNode::File),
            ViewSource::Patched(tree) => tree.root()?.map_node(ViewSourceNode::Patched),
            ViewSource::Memory(memory) => memory.tree.root()?.map_node(ViewSourceNode::Memory),
            ViewSource::Warped(tree) => tree.root()?.map_node(ViewSourceNode::Warped),
            ViewSource::Calculated(tree) => tree.root()?.map_node(ViewSourceNode::Calculated),
            ViewSource::Coarse(tree) => tree.root()?.map_node(ViewSourceNode::Coarse),
            ViewSource::Regions(tree) => tree.root()?.map_node(ViewSourceNode::Regions),
            ViewSource::Blockwise(tree) => tree.root()?.map_node(ViewSourceNode::Blockwise),
            ViewSource::Converted(tree) => tree.root()?,
        })
    }

    fn children(&self, node: &ViewSourceNode, children: &mut Children<ViewSourceNode>) -> Result<()> {
        self.children_as(node, children, |node| node)
    }

    fn draw(&self, bounds: &Bounds, values: &mut [u8], valid: &mut [bool]) -> Result<bool> {
        match self {
            ViewSource::File(file) => file.draw(bounds, values, valid),
            ViewSource::Warped(tree) => tree.draw(bounds, values, valid),
            ViewSource::Calculated(tree) => tree.draw(bounds, values, valid),
            ViewSource::Coarse(tree) => tree.draw(bounds, values, valid),
            ViewSource::Regions(tree) => tree.draw(bounds, values, valid),
            ViewSource::Converted(tree) => tree.draw(bounds, values, valid),
            ViewSource::Patched(_) | ViewSource::Memory(_) | ViewSource::Blockwise(_) => Ok(false),
        }
    }

    fn cells(&self, node: &ViewSourceNode, levels: u8) -> Result<Option<CellBlock>> {
        match (self, node) {
            (ViewSource::File(file), ViewSourceNode::File(node)) => file.cells(node, levels),
            (ViewSource::Patched(tree), ViewSourceNode::Patched(node)) => tree.cells(node, levels),
            (ViewSource::Warped(tree), ViewSourceNode::Warped(node)) => tree.cells(node, levels),
            (ViewSource::Calculated(tree), ViewSourceNode::Calculated(node)) => tree.cells(node, levels),
            (ViewSource::Regions(tree), ViewSourceNode::Regions(node)) => tree.cells(node, levels),
            (ViewSource::Blockwise(tree), ViewSourceNode::Blockwise(node)) => tree.cells(node, levels),
            (ViewSource::Converted(tree), node) => tree.cells(node, levels),
            _ => Ok(None),
        }
    }

    fn check_unchanged(&self) -> Result<()> {
        match self {
            ViewSource::File(file) => file.check_unchanged(),
            ViewSource::Patched(tree) => tree.check_unchanged(),
            ViewSource::Warped(tree) => tree.check_unchanged(),
            ViewSource::Calculated(tree) => tree.check_unchanged(),
            ViewSource::Converted(tree) => tree.source().check_unchanged(),
            ViewSource::Coarse(tree) => tree.check_unchanged(),
            ViewSource::Regions(tree) => tree.check_unchanged(),
            ViewSource::Memory(_) | ViewSource::Blockwise(_) => Ok(()),
        }
    }

    fn tally(&self, node: &ViewSourceNode) -> Result<Option<ZoneStats>> {
        match (self, node) {
            (ViewSource::File(file), ViewSourceNode::File(node)) => file.tally(node),
            (ViewSource::Patched(tree), ViewSourceNode::Patched(node)) => tree.tally(node),
            _ => Ok(None),
        }
    }
}

impl ReusableSource for ViewSource {
    fn stored(&self, node: &ViewSourceNode) -> Option<StoredNode<'_>> {
        match (self, node) {
            (ViewSource::File(file), ViewSourceNode::File(node)) => file.stored(node),
            (ViewSource::Patched(tree), ViewSourceNode::Patched(node)) => tree.stored(node),
            _ => None,
        }
    }

    fn kept(&self, node: &ViewSourceNode) -> Option<RecordRef> {
        match (self, node) {
            (ViewSource::File(file), ViewSourceNode::File(node)) => file.kept(node),
            (ViewSource::Patched(tree), ViewSourceNode::Patched(node)) => tree.kept(node),
            _ => None,
        }
    }
}

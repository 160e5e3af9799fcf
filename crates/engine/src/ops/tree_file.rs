//! The base of views and edits: a tree file of either format, one with changes that are not written yet, one seen on another
//! grid, or a tree in memory.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use super::patched::{Patched, PatchedNode};
use super::warp::Warped;
use crate::query::{Canvas, Statistics, autumnal_statistics, source_statistics};
use crate::store::autumnal::{self, Autumnal, Commit};
use crate::store::builder::{RecordRef, ReusableSource, StoredNode};
use crate::store::goblin::{self, Goblin};
use crate::tree::{CellBlock, Child, Children, MemTree, Source, no_children};
use spinney_base::Form;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{Kind, Rule, Tally, Value};
use spinney_base::{Error, Progress, Result};
use spinney_container::{Codec, Finding, Header, Metadata, OpenOptions, Shape, TreeFormat, split_commit};
use spinney_container::{HEAVY_THRESHOLD, STRIDE, reach};

/// A tree file of either format, open for reading, or something that stands for one.
pub enum TreeFile {
    /// Published.
    Goblin(Box<Goblin>),
    /// Edited: one of its commits.
    Autumnal(Arc<Autumnal>),
    /// One of its commits with changes on it that are not written yet.
    Patched(Patched),
    /// A small tree in memory.
    Memory(Box<MemoryTree>),
    /// Another file on the grid of another coordinate system.
    Warped(Box<Warped>),
}

/// An INNER node of an open file.
#[derive(Clone, Copy, Debug)]
pub enum TreeFileNode {
    /// Of a Goblin file.
    Goblin(goblin::GoblinNode),
    /// Of an Autumnal file.
    Autumnal(autumnal::AutumnalNode),
    /// Of one with changes.
    Patched(PatchedNode),
    /// Of a tree in memory.
    Memory(<MemTree as Source>::Node),
    /// Of one on another grid.
    Warped(Code),
}

/// A tree in memory with the header and metadata that a file of it would have.
pub struct MemoryTree {
    tree: MemTree,
    header: Header,
    metadata: Metadata,
}

impl MemoryTree {
    /// A tree whose picture is the whole space, of values that are averaged, with empty metadata.
    fn new(tree: MemTree) -> MemoryTree {
        let (form, depth) = (tree.form(), tree.depth());
        let header = Header {
            form,
            rule: Rule::Mean,
            kind: Kind::Continuous,
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

impl TreeFile {
    /// Opens a file, or a commit of one: see [`split_commit`].
    ///
    /// # Errors
    /// If it cannot be read, is no tree file, or is damaged.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<TreeFile> {
        let (name, commit) = split_commit(path);
        let opened = options.open_with_id(&name)?;
        let (format, _) = Header::read(&name, &*opened.0)?;
        match (format, commit) {
            (TreeFormat::Goblin, None) => Ok(Goblin::from_backend(path, opened.0, options)?.into()),
            // There are no commits in it: only a file whose name is all of the path can be meant.
            (TreeFormat::Goblin, Some(_)) => Ok(Goblin::open(path, options)?.into()),
            (TreeFormat::Autumnal, _) => Ok(Autumnal::of_opened(path, opened, options)?.into()),
        }
    }

    /// The file, for messages.
    pub fn path(&self) -> &Path {
        match self {
            TreeFile::Goblin(file) => file.path(),
            TreeFile::Autumnal(file) => file.path(),
            TreeFile::Patched(file) => file.file().path(),
            TreeFile::Memory(_) => Path::new("(memory)"),
            TreeFile::Warped(tree) => tree.source().path(),
        }
    }

    /// A remark on the file that whoever reads it should know: see [`Autumnal::remark`].
    pub fn remark(&self) -> Option<&'static str> {
        match self {
            TreeFile::Autumnal(file) => file.remark(),
            TreeFile::Patched(file) => file.file().remark(),
            TreeFile::Warped(tree) => tree.source().remark(),
            TreeFile::Goblin(_) | TreeFile::Memory(_) => None,
        }
    }

    /// Hands the remark on the file, if there is one, to whoever waits for the work.
    pub(super) fn tell_remark(&self, progress: &dyn Progress) {
        if let Some(remark) = self.remark() {
            progress.warn(self.path(), remark);
        }
        if let TreeFile::Warped(tree) = self {
            tree.remarks().iter().for_each(|remark| progress.warn(self.path(), remark));
        }
    }

    /// The header: form, rule, shape, extent.
    pub fn header(&self) -> &Header {
        match self {
            TreeFile::Goblin(file) => file.header(),
            TreeFile::Autumnal(file) => file.header(),
            TreeFile::Patched(file) => file.file().header(),
            TreeFile::Memory(tree) => &tree.header,
            TreeFile::Warped(tree) => tree.header(),
        }
    }

    /// The metadata: frame, nodata, palette, names, provenance.
    pub fn metadata(&self) -> &Metadata {
        match self {
            TreeFile::Goblin(file) => file.metadata(),
            TreeFile::Autumnal(file) => file.metadata(),
            TreeFile::Patched(file) => file.file().metadata(),
            TreeFile::Memory(tree) => &tree.metadata,
            TreeFile::Warped(tree) => tree.metadata(),
        }
    }

    /// The file's format; a tree in memory or on another grid counts as published.
    pub fn format(&self) -> TreeFormat {
        match self {
            TreeFile::Goblin(_) | TreeFile::Memory(_) | TreeFile::Warped(_) => TreeFormat::Goblin,
            TreeFile::Autumnal(_) | TreeFile::Patched(_) => TreeFormat::Autumnal,
        }
    }

    /// The Autumnal file that this is, without changes that are not written yet.
    fn autumnal(&self) -> Option<&Autumnal> {
        match self {
            TreeFile::Autumnal(file) => Some(file),
            TreeFile::Patched(file) => Some(file.file()),
            TreeFile::Goblin(_) | TreeFile::Memory(_) | TreeFile::Warped(_) => None,
        }
    }

    /// The commit that is read; only Autumnal files have commits.
    pub fn commit(&self) -> Option<&Commit> {
        self.autumnal().map(Autumnal::commit)
    }

    /// Bytes of the whole file.
    pub fn file_size(&self) -> u64 {
        match self {
            TreeFile::Goblin(file) => file.file_size(),
            _ => self.autumnal().map_or(0, Autumnal::file_size),
        }
    }

    /// Number of segments; 0 in Autumnal files, which have none.
    pub fn segments(&self) -> usize {
        if let TreeFile::Goblin(file) = self { file.segments() } else { 0 }
    }

    /// Places of records in all segments, of which dense blocks need fewer, and records that are stored more than once more; in
    /// Autumnal files the records of the commit's tree, the shared ones as often as they occur.
    pub fn stored_records(&self) -> u64 {
        match self {
            TreeFile::Goblin(file) => file.stored_records(),
            TreeFile::Memory(tree) => tree.tree.inner_nodes() as u64,
            _ => self.commit().map_or(0, |commit| commit.records),
        }
    }

    /// INNER nodes of a tree of which a file may have stored any number once: of Autumnal files all, else none.
    pub(super) fn shared_records(&self) -> Result<u64> {
        self.autumnal().map_or(Ok(0), Autumnal::claimed_records)
    }

    /// Name and bytes of each part of the file.
    pub fn sections(&self) -> Vec<(&'static str, u64)> {
        match self {
            TreeFile::Goblin(file) => file.sections(),
            _ => self.autumnal().map_or_else(Vec::new, Autumnal::sections),
        }
    }

    /// The root, however many nodes there are below it: for those who look at each record once.
    pub(super) fn any_root(&self) -> Result<Child<TreeFileNode>> {
        match self {
            TreeFile::Autumnal(file) => Ok(file.root_child().map_node(TreeFileNode::Autumnal)),
            file => file.root(),
        }
    }

    /// Checks everything: see [`Goblin::verify`] and [`Autumnal::verify`].
    ///
    /// # Errors
    /// If the file cannot be read, or on interruption.
    pub fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        match self {
            TreeFile::Goblin(file) => file.verify(memory, progress),
            _ => self.autumnal().map_or_else(|| Ok(Vec::new()), |file| file.verify(memory, progress)),
        }
    }

    /// Exact statistics of a box of cells (of the deepest level); the whole picture if there is none.
    ///
    /// # Errors
    /// If the file is damaged there.
    pub fn statistics(&self, bounds: Option<Bounds>) -> Result<Statistics> {
        self.statistics_with(bounds, self.header().counts_classes())
    }

    /// Cells and channels of a box, as [`TreeFile::statistics`] has them, without classes: these may take longer. Of all of a file on
    /// another grid those of the file.
    ///
    /// # Errors
    /// If the file is damaged there.
    pub fn totals(&self, bounds: Option<Bounds>) -> Result<Statistics> {
        match (self, bounds) {
            // (Its own cells would have to be computed, all of them.)
            (TreeFile::Warped(tree), None) => tree.source().totals(None),
            _ => self.statistics_with(bounds, false),
        }
    }

    fn statistics_with(&self, bounds: Option<Bounds>, count_classes: bool) -> Result<Statistics> {
        let bounds = self.header().within_picture(bounds);
        match self {
            TreeFile::Goblin(file) => file.statistics_with(Some(bounds), count_classes),
            TreeFile::Autumnal(file) => autumnal_statistics(file, &bounds, count_classes),
            TreeFile::Patched(_) | TreeFile::Memory(_) | TreeFile::Warped(_) => {
                source_statistics(self, &bounds, count_classes)
            }
        }
    }

    /// Writes the children of an inner node as nodes of something that stands on this file: what
    /// [`Source::children`] does, without a second array for those who have nodes of their own.
    pub(super) fn children_as<N>(
        &self,
        node: &TreeFileNode,
        children: &mut Children<N>,
        node_of: impl Fn(TreeFileNode) -> N,
    ) -> Result<()> {
        match (self, node) {
            (TreeFile::Goblin(file), TreeFileNode::Goblin(node)) => {
                file.children_with(node, children, |node| node_of(TreeFileNode::Goblin(node)))
            }
            (TreeFile::Autumnal(file), TreeFileNode::Autumnal(node)) => {
                file.children_with(node, children, |node| node_of(TreeFileNode::Autumnal(node)))
            }
            (TreeFile::Patched(file), TreeFileNode::Patched(node)) => {
                let mut found = no_children();
                file.children(node, &mut found)?;
                hand_on(&found, children, file.form(), |node| node_of(TreeFileNode::Patched(node)));
                Ok(())
            }
            (TreeFile::Memory(file), TreeFileNode::Memory(node)) => {
                let mut found = no_children();
                file.tree.children(node, &mut found)?;
                hand_on(&found, children, file.tree.form(), |node| node_of(TreeFileNode::Memory(node)));
                Ok(())
            }
            (TreeFile::Warped(tree), TreeFileNode::Warped(node)) => {
                let mut found = no_children();
                tree.children(node, &mut found)?;
                hand_on(&found, children, tree.form(), |node| node_of(TreeFileNode::Warped(node)));
                Ok(())
            }
            _ => unreachable!("{OTHER}"),
        }
    }

    /// Draws a box of cells of a level inside the tree's space as [`Source::draw`] does.
    ///
    /// # Errors
    /// If the file is damaged there, or there is no such level.
    pub(super) fn draw_at(
        &self,
        level: u8,
        bounds: &Bounds,
        values: &mut [u8],
        valid: &mut [bool],
    ) -> Result<()> {
        match self {
            TreeFile::Goblin(file) => {
                file.window(level, bounds, Value::ZERO, values, Some(valid)).map(|_| ())
            }
            TreeFile::Autumnal(file) => file.window(level, bounds, Value::ZERO, values, Some(valid)),
            _ => Canvas::new(self.form(), bounds, Value::ZERO, values, Some(valid))?.draw(
                self,
                self.root()?,
                level,
            ),
        }
    }
}

/// Fails unless a tree is of the same form as another one; the paths are for the message.
pub(super) fn check_form((path, form): (&Path, Form), (other, expected): (&Path, Form)) -> Result<()> {
    // (Missing samples stay what they are: numbers, for whoever joins them with others.)
    if form.without_missing() == expected.without_missing() {
        return Ok(());
    }
    let expected = format!("{expected}, as {} is", other.display());
    Err(Error::invalid(path.display().to_string(), form.to_string(), expected))
}

/// A node that does not belong to the file.
const OTHER: &str = "nodes go to the file that they are from";

/// Writes children with other nodes.
#[inline]
fn hand_on<M: Copy, N>(
    found: &Children<M>,
    children: &mut Children<N>,
    form: Form,
    node_of: impl Fn(M) -> N,
) {
    for (child, found) in children.iter_mut().zip(found).take(form.children()) {
        *child = found.map_node(&node_of);
    }
}

impl From<Goblin> for TreeFile {
    fn from(file: Goblin) -> TreeFile {
        TreeFile::Goblin(Box::new(file))
    }
}

impl From<Autumnal> for TreeFile {
    fn from(file: Autumnal) -> TreeFile {
        TreeFile::Autumnal(Arc::new(file))
    }
}

impl From<Arc<Autumnal>> for TreeFile {
    fn from(file: Arc<Autumnal>) -> TreeFile {
        TreeFile::Autumnal(file)
    }
}

impl From<Patched> for TreeFile {
    fn from(file: Patched) -> TreeFile {
        TreeFile::Patched(file)
    }
}

/// The tree's picture is its whole space; the metadata are empty.
impl From<MemTree> for TreeFile {
    fn from(tree: MemTree) -> TreeFile {
        TreeFile::Memory(Box::new(MemoryTree::new(tree)))
    }
}

impl From<Warped> for TreeFile {
    fn from(tree: Warped) -> TreeFile {
        TreeFile::Warped(Box::new(tree))
    }
}

impl fmt::Debug for TreeFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("TreeFile").field(&self.path()).finish()
    }
}

impl Source for TreeFile {
    type Node = TreeFileNode;

    fn form(&self) -> Form {
        self.header().form
    }

    fn depth(&self) -> u8 {
        self.header().depth()
    }

    fn root(&self) -> Result<Child<TreeFileNode>> {
        Ok(match self {
            TreeFile::Goblin(file) => file.root()?.map_node(TreeFileNode::Goblin),
            TreeFile::Autumnal(file) => file.root()?.map_node(TreeFileNode::Autumnal),
            TreeFile::Patched(file) => file.root()?.map_node(TreeFileNode::Patched),
            TreeFile::Memory(file) => file.tree.root()?.map_node(TreeFileNode::Memory),
            TreeFile::Warped(tree) => tree.root()?.map_node(TreeFileNode::Warped),
        })
    }

    fn children(&self, node: &TreeFileNode, children: &mut Children<TreeFileNode>) -> Result<()> {
        self.children_as(node, children, |node| node)
    }

    fn draw(&self, bounds: &Bounds, values: &mut [u8], valid: &mut [bool]) -> Result<bool> {
        match self {
            TreeFile::Goblin(_) | TreeFile::Autumnal(_) => {
                self.draw_at(self.depth(), bounds, values, valid).map(|()| true)
            }
            TreeFile::Warped(tree) => tree.draw(bounds, values, valid),
            TreeFile::Patched(_) | TreeFile::Memory(_) => Ok(false),
        }
    }

    fn cells(&self, node: &TreeFileNode, levels: u8) -> Result<Option<CellBlock>> {
        match (self, node) {
            (TreeFile::Goblin(file), TreeFileNode::Goblin(node)) => file.cells(node, levels),
            (TreeFile::Autumnal(file), TreeFileNode::Autumnal(node)) => file.cells(node, levels),
            (TreeFile::Patched(file), TreeFileNode::Patched(node)) => file.cells(node, levels),
            (TreeFile::Warped(tree), TreeFileNode::Warped(node)) => tree.cells(node, levels),
            _ => Ok(None),
        }
    }

    fn check_unchanged(&self) -> Result<()> {
        match self {
            TreeFile::Goblin(file) => file.check_unchanged(),
            TreeFile::Autumnal(file) => file.check_unchanged(),
            TreeFile::Patched(file) => file.check_unchanged(),
            TreeFile::Warped(tree) => tree.check_unchanged(),
            TreeFile::Memory(_) => Ok(()),
        }
    }

    fn tally(&self, node: &TreeFileNode) -> Result<Option<Tally>> {
        match (self, node) {
            (TreeFile::Autumnal(file), TreeFileNode::Autumnal(node)) => file.tally(node),
            (TreeFile::Patched(file), TreeFileNode::Patched(node)) => file.tally(node),
            _ => Ok(None),
        }
    }
}

impl ReusableSource for TreeFile {
    fn stored(&self, node: &TreeFileNode) -> Option<StoredNode<'_>> {
        match (self, node) {
            (TreeFile::Goblin(file), TreeFileNode::Goblin(node)) => file.stored(node),
            (TreeFile::Autumnal(file), TreeFileNode::Autumnal(node)) => file.stored(node),
            (TreeFile::Patched(file), TreeFileNode::Patched(node)) => file.stored(node),
            _ => None,
        }
    }

    fn kept(&self, node: &TreeFileNode) -> Option<RecordRef> {
        match (self, node) {
            (TreeFile::Autumnal(file), TreeFileNode::Autumnal(node)) => file.kept(node),
            (TreeFile::Patched(file), TreeFileNode::Patched(node)) => file.kept(node),
            _ => None,
        }
    }
}

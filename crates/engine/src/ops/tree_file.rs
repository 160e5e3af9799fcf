//! Tree files of either format, and manifests of many files that act as one tree.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use super::adjacent_index::open_adjacent_index;
use super::mosaic::{Mosaic, MosaicNode};
use crate::query::{Statistics, autumnal_statistics, source_statistics, tally_of};
use crate::store::autumnal::{Autumnal, AutumnalNode, Commit};
use crate::store::builder::{RecordRef, ReusableSource, StoredNode};
use crate::store::goblin::{Goblin, GoblinNode};
use crate::tree::{CellBlock, Child, Children, Source};
use spinney_base::io::FileAccess;
use spinney_base::space::Bounds;
use spinney_base::value::{Value, ZoneStats};
use spinney_base::{Error, Progress, Result, TreeType};
use spinney_container::{
    FIRST_BYTES, FileHeader, FileReference, Finding, Header, Layer, MAX_FINDINGS, Metadata, OpenOptions,
    TreeFormat,
};
use spinney_manifest::{Manifest, is_manifest};

/// Tree file of either format, or a manifest of several files, open for reading. A clone shares the
/// open file.
#[derive(Clone)]
pub enum TreeFile {
    /// Published, read-only file.
    Goblin(Arc<Goblin>),
    /// One commit of an editable file.
    Autumnal(Arc<Autumnal>),
    /// Many files, as listed in a manifest.
    Mosaic(Arc<Mosaic>),
}

/// Layer of a file: one of its trees.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerInfo {
    /// Name; may be empty if the file has only this layer.
    pub name: String,
    /// Tree type, rule, kind, depth and extent.
    pub header: Header,
    /// Bytes of its segments and segment index, where the layer has its own: in Goblin files.
    pub bytes: Option<u64>,
}

/// An INNER node of an open file.
#[derive(Clone, Copy, Debug)]
pub enum TreeFileNode {
    /// Node of a Goblin file.
    Goblin(GoblinNode),
    /// Node of an Autumnal file.
    Autumnal(AutumnalNode),
    /// Node of a manifest's files.
    Mosaic(MosaicNode),
}

impl TreeFile {
    /// Opens a file, or a commit or a layer of it: see [`FileReference`]. For a TIFF file, opens
    /// the index of it with the added extension `.goblin`.
    ///
    /// # Errors
    /// If it cannot be read, is no tree file, or is corrupt.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<TreeFile> {
        let place = FileReference::of(path);
        match place.commit {
            // Goblin files have no commits: the `@` belongs to the file name.
            Some(commit)
                if FileHeader::read(&place.file, &*options.open(&place.file)?)?.format
                    == TreeFormat::Goblin =>
            {
                match Goblin::open(path, options) {
                    Err(Error::Io { cause, .. }) if cause.kind() == std::io::ErrorKind::NotFound => {
                        let what = format!("{}: commit", place.file.display());
                        let expected = "none: a Goblin file has no commits";
                        Err(Error::invalid(what, commit.to_string(), expected))
                    }
                    found => Ok(found?.into()),
                }
            }
            _ => TreeFile::at(&place, options),
        }
    }

    /// Opens the file, commit and layer of a reference.
    ///
    /// # Errors
    /// Those of [`TreeFile::open`].
    pub fn at(place: &FileReference<'_>, options: &OpenOptions) -> Result<TreeFile> {
        let opened = options.open_with_id(&place.file)?;
        let first = opened.0.read(0, opened.0.len().min(FIRST_BYTES as u64) as usize)?;
        if is_manifest(&first) {
            drop(first);
            Manifest::check_length(&place.file, opened.0.len())?;
            let bytes = opened.0.read(0, opened.0.len() as usize)?;
            place.layer_number([""].into_iter())?;
            return Ok(TreeFile::Mosaic(Arc::new(Mosaic::from_bytes(&place.file, &bytes, options)?)));
        }
        drop(first);
        let header = match FileHeader::read_cells(&place.file, &*opened.0) {
            Err(error @ Error::NotATree { .. }) => {
                return open_adjacent_index(place, &*opened.0, options)?.ok_or(error);
            }
            header => header?,
        };
        match header.format {
            TreeFormat::Autumnal => Ok(Autumnal::of_opened(place, opened, options)?.into()),
            TreeFormat::Goblin => {
                let file = Goblin::from_backend(&place.file, opened.0, options)?;
                let number = place.layer_number(file.layers().iter().map(|layer| &*layer.name))?;
                Ok(if number == 0 { file } else { file.open_layer(number)? }.into())
            }
        }
    }

    /// Opens a file of one layer, or one layer that the path names.
    ///
    /// # Errors
    /// Those of [`TreeFile::open`]; also if the file has several layers and none is named.
    pub(crate) fn open_only(path: &Path, options: &OpenOptions) -> Result<TreeFile> {
        let file = TreeFile::open(path, options)?;
        let layers = file.layers()?;
        if layers.len() == 1 || FileReference::of(path).layer.is_some() {
            return Ok(file);
        }
        let names: Vec<&str> = layers.iter().take(20).map(|layer| &*layer.name).collect();
        let more = if layers.len() > names.len() { ", ..." } else { "" };
        let place = FileReference::of(path).of_layer(names[0]);
        let advice = format!("name a layer, as in {} (layers: {}{more})", place.display(), names.join(", "));
        Err(Error::unsupported(path, format!("a file of {} layers instead of one", layers.len()), advice))
    }

    /// Names and headers of the layers of the file, or of the commit that is read.
    ///
    /// # Errors
    /// If a layer is corrupt.
    pub fn layers(&self) -> Result<Vec<LayerInfo>> {
        match self {
            TreeFile::Goblin(file) => {
                let layer = |layer: &Layer| LayerInfo {
                    name: layer.name.clone(),
                    header: layer.header.clone(),
                    bytes: Some(layer.run.length),
                };
                Ok(file.layers().iter().map(layer).collect())
            }
            TreeFile::Autumnal(file) => {
                let names = file.commit().layers().iter().map(|layer| layer.name.clone());
                let layer = |(name, header)| LayerInfo { name, header, bytes: None };
                Ok(names.zip(file.layer_headers()?).map(layer).collect())
            }
            TreeFile::Mosaic(tree) => {
                Ok(vec![LayerInfo { name: String::new(), header: tree.header().clone(), bytes: None }])
            }
        }
    }

    /// Index of the layer that is read.
    pub fn layer_number(&self) -> usize {
        match self {
            TreeFile::Goblin(file) => file.layer_number(),
            TreeFile::Autumnal(file) => file.layer_number(),
            TreeFile::Mosaic(_) => 0,
        }
    }

    /// Another layer of the same file or commit, without opening the file again.
    ///
    /// # Errors
    /// If it is corrupt.
    ///
    /// # Panics
    /// If there is no layer with this index.
    pub fn open_layer(&self, number: usize) -> Result<TreeFile> {
        match self {
            TreeFile::Goblin(file) => Ok(file.open_layer(number)?.into()),
            TreeFile::Autumnal(file) => Ok(file.open_layer(number)?.into()),
            TreeFile::Mosaic(_) => Ok(self.clone()),
        }
    }

    /// Path of the file, or a placeholder for messages if the file was read from memory.
    pub fn path(&self) -> &Path {
        match self {
            TreeFile::Goblin(file) => file.path(),
            TreeFile::Autumnal(file) => file.path(),
            TreeFile::Mosaic(tree) => tree.path(),
        }
    }

    /// How the file was opened. Files that it names are opened in the same way.
    pub fn access(&self) -> &FileAccess {
        match self {
            TreeFile::Goblin(file) => file.access(),
            TreeFile::Autumnal(file) => file.access(),
            TreeFile::Mosaic(tree) => tree.access(),
        }
    }

    /// Warning about the file for its reader: see [`Autumnal::remark`].
    pub fn remark(&self) -> Option<&'static str> {
        self.autumnal().and_then(|file| file.remark())
    }

    /// Header: tree type, rule, shape, extent.
    pub fn header(&self) -> &Header {
        match self {
            TreeFile::Goblin(file) => file.header(),
            TreeFile::Autumnal(file) => file.header(),
            TreeFile::Mosaic(tree) => tree.header(),
        }
    }

    /// Metadata: frame, nodata, palette, names, provenance.
    pub fn metadata(&self) -> &Metadata {
        match self {
            TreeFile::Goblin(file) => file.metadata(),
            TreeFile::Autumnal(file) => file.metadata(),
            TreeFile::Mosaic(tree) => tree.metadata(),
        }
    }

    /// Format of the file; for a manifest, the format of its files.
    pub fn format(&self) -> TreeFormat {
        match self {
            TreeFile::Goblin(_) | TreeFile::Mosaic(_) => TreeFormat::Goblin,
            TreeFile::Autumnal(_) => TreeFormat::Autumnal,
        }
    }

    fn autumnal(&self) -> Option<&Autumnal> {
        match self {
            TreeFile::Goblin(_) | TreeFile::Mosaic(_) => None,
            TreeFile::Autumnal(file) => Some(file),
        }
    }

    /// Commit that is read; `None` for Goblin files, which have no commits.
    pub fn commit(&self) -> Option<&Commit> {
        self.autumnal().map(Autumnal::commit)
    }

    /// Size of the whole file in bytes, for a manifest including its files.
    pub fn file_size(&self) -> u64 {
        match self {
            TreeFile::Goblin(file) => file.file_size(),
            TreeFile::Autumnal(file) => file.file_size(),
            TreeFile::Mosaic(tree) => tree.bytes(),
        }
    }

    /// Number of segments; 0 in Autumnal files, which have none.
    pub fn segments(&self) -> usize {
        match self {
            TreeFile::Goblin(file) => file.segments(),
            TreeFile::Autumnal(_) | TreeFile::Mosaic(_) => 0,
        }
    }

    /// Number of stored records. In Goblin files these are record slots in all segments: dense
    /// blocks need fewer, records that are stored repeatedly count repeatedly. In Autumnal files
    /// these are the INNER nodes of the commit's tree; nodes of shared subtrees count as often as
    /// they occur.
    pub fn stored_records(&self) -> u64 {
        match self {
            TreeFile::Goblin(file) => file.stored_records(),
            TreeFile::Autumnal(file) => file.inner_nodes(),
            TreeFile::Mosaic(_) => 0,
        }
    }

    /// Number of INNER nodes in trees whose records may be shared, so that few are stored: in
    /// Autumnal files all, else 0.
    pub(super) fn shared_records(&self) -> Result<u64> {
        self.autumnal().map_or(Ok(0), Autumnal::claimed_inner_nodes)
    }

    /// Name and size in bytes of each section of the file.
    pub fn sections(&self) -> Vec<(&'static str, u64)> {
        match self {
            TreeFile::Goblin(file) => file.sections(),
            TreeFile::Autumnal(file) => file.sections(),
            TreeFile::Mosaic(_) => Vec::new(),
        }
    }

    /// Root, with no check of how many nodes are below it: for readers that visit each record only
    /// once.
    pub(super) fn any_root(&self) -> Result<Child<TreeFileNode>> {
        match self {
            TreeFile::Goblin(_) | TreeFile::Mosaic(_) => self.root(),
            TreeFile::Autumnal(file) => Ok(file.root_child().map_node(TreeFileNode::Autumnal)),
        }
    }

    /// Verifies everything (see [`Goblin::verify`] and [`Autumnal::verify`]), and that all cells
    /// outside of the extent are VOID.
    ///
    /// # Errors
    /// If the file cannot be read, or on cancellation.
    pub fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let findings = match self {
            TreeFile::Goblin(file) => file.verify(memory, progress),
            TreeFile::Autumnal(file) => file.verify(memory, progress),
            TreeFile::Mosaic(tree) => return tree.verify(memory, progress),
        };
        self.verify_extents(findings?, progress)
    }

    /// Verifies everything but the trees of older commits, and the cells that are in other files.
    ///
    /// # Errors
    /// If the file cannot be read, or on cancellation.
    pub fn verify_quickly(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let findings = match self {
            TreeFile::Goblin(file) if file.references().is_some() => {
                return file.verify_quickly(progress);
            }
            TreeFile::Goblin(file) => file.verify(memory, progress),
            TreeFile::Autumnal(file) => file.verify_quickly(memory, progress),
            TreeFile::Mosaic(tree) => return tree.verify(memory, progress),
        };
        self.verify_extents(findings?, progress)
    }

    /// Checks that all cells outside of the layers' extents are VOID, if there are no other
    /// findings.
    fn verify_extents(&self, mut findings: Vec<Finding>, progress: &dyn Progress) -> Result<Vec<Finding>> {
        if !findings.is_empty() {
            return Ok(findings);
        }
        for (number, layer) in self.layers()?.into_iter().enumerate() {
            progress.check()?;
            let cells = self.open_layer(number)?.cells_outside(progress)?;
            if cells > 0 {
                let place =
                    if layer.name.is_empty() { "tree".into() } else { format!("layer `{}`", layer.name) };
                let problem = format!(
                    "{cells} cells that are not VOID outside of the extent {:?}",
                    layer.header.extent
                );
                findings.push(Finding { place, problem });
            }
        }
        findings.truncate(MAX_FINDINGS);
        Ok(findings)
    }

    /// Number of cells outside of the extent that are not VOID.
    fn cells_outside(&self, progress: &dyn Progress) -> Result<u64> {
        let header = self.header();
        let mut rest = Bounds::space(header.form.dimension, header.depth());
        let mut cells = 0;
        for axis in 0..header.form.axes() {
            let mut outside = rest;
            (outside.min[axis], rest.max[axis]) = (header.extent[axis], header.extent[axis]);
            if !outside.is_empty() {
                cells += match self {
                    TreeFile::Goblin(file) => tally_of(file, &outside, false)?.cells,
                    TreeFile::Autumnal(file) => autumnal_statistics(file, &outside, false, progress)?.cells,
                    // (Files are checked to lie in their boxes, and the boxes to lie in the
                    // extent.)
                    TreeFile::Mosaic(_) => 0,
                };
            }
        }
        Ok(cells)
    }

    /// Exact statistics of a box of cells at the deepest level.
    pub(super) fn statistics_with(
        &self,
        bounds: &Bounds,
        count_classes: bool,
        progress: &dyn Progress,
    ) -> Result<Statistics> {
        match self {
            TreeFile::Goblin(file) => file.statistics_with(Some(*bounds), count_classes, progress),
            TreeFile::Autumnal(file) => autumnal_statistics(file, bounds, count_classes, progress),
            TreeFile::Mosaic(tree) => source_statistics(&**tree, bounds, count_classes, progress),
        }
    }

    /// Writes the children of an INNER node as nodes of a source that derives from this file.
    /// Equivalent to [`Source::children`], without a second array for sources with their own node
    /// type.
    #[inline]
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
            (TreeFile::Mosaic(tree), TreeFileNode::Mosaic(node)) => {
                tree.children_as(node, children, |node| node_of(TreeFileNode::Mosaic(node)))
            }
            _ => Err(other_node(self.path())),
        }
    }

    /// Representative of an INNER node, computed if it was left out: in nodes that span several
    /// files of a manifest.
    pub(super) fn representative(&self, node: &TreeFileNode, given: Value) -> Result<Value> {
        match (self, node) {
            (TreeFile::Mosaic(tree), TreeFileNode::Mosaic(node)) => tree.representative(node, given),
            _ => Ok(given),
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
            TreeFile::Goblin(file) => {
                file.window(level, bounds, Value::ZERO, values, Some(valid)).map(|_| ())
            }
            TreeFile::Autumnal(file) => file.window(level, bounds, Value::ZERO, values, Some(valid)),
            TreeFile::Mosaic(tree) => tree.draw_at(level, bounds, values, valid),
        }
    }
}

/// Error for a node of another source.
#[cold]
pub(super) fn other_node(name: &Path) -> Error {
    Error::invalid(name.display().to_string(), "a node of another tree", "a node of this tree")
}

impl From<Goblin> for TreeFile {
    fn from(file: Goblin) -> TreeFile {
        TreeFile::Goblin(Arc::new(file))
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

impl fmt::Debug for TreeFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("TreeFile").field(&self.path()).finish()
    }
}

impl Source for TreeFile {
    type Node = TreeFileNode;

    fn form(&self) -> TreeType {
        self.header().form
    }

    fn depth(&self) -> u8 {
        self.header().depth()
    }

    fn root(&self) -> Result<Child<TreeFileNode>> {
        Ok(match self {
            TreeFile::Goblin(file) => file.root()?.map_node(TreeFileNode::Goblin),
            TreeFile::Autumnal(file) => file.root()?.map_node(TreeFileNode::Autumnal),
            TreeFile::Mosaic(tree) => tree.root()?.map_node(TreeFileNode::Mosaic),
        })
    }

    fn children(&self, node: &TreeFileNode, children: &mut Children<TreeFileNode>) -> Result<()> {
        self.children_as(node, children, |node| node)
    }

    fn draw(&self, bounds: &Bounds, values: &mut [u8], valid: &mut [bool]) -> Result<bool> {
        self.draw_at(self.depth(), bounds, values, valid).map(|()| true)
    }

    fn cells(&self, node: &TreeFileNode, levels: u8) -> Result<Option<CellBlock>> {
        match (self, node) {
            (TreeFile::Goblin(file), TreeFileNode::Goblin(node)) => file.cells(node, levels),
            (TreeFile::Autumnal(file), TreeFileNode::Autumnal(node)) => file.cells(node, levels),
            (TreeFile::Mosaic(tree), TreeFileNode::Mosaic(node)) => tree.cells(node, levels),
            _ => Ok(None),
        }
    }

    fn check_unchanged(&self) -> Result<()> {
        match self {
            TreeFile::Goblin(file) => file.check_unchanged(),
            TreeFile::Autumnal(file) => file.check_unchanged(),
            TreeFile::Mosaic(tree) => tree.check_unchanged(),
        }
    }

    fn tally(&self, node: &TreeFileNode) -> Result<Option<ZoneStats>> {
        match (self, node) {
            (TreeFile::Autumnal(file), TreeFileNode::Autumnal(node)) => file.tally(node),
            (TreeFile::Mosaic(tree), TreeFileNode::Mosaic(node)) => tree.tally(node),
            _ => Ok(None),
        }
    }
}

impl ReusableSource for TreeFile {
    fn stored(&self, node: &TreeFileNode) -> Option<StoredNode<'_>> {
        match (self, node) {
            (TreeFile::Goblin(file), TreeFileNode::Goblin(node)) => file.stored(node),
            (TreeFile::Autumnal(file), TreeFileNode::Autumnal(node)) => file.stored(node),
            _ => None,
        }
    }

    fn kept(&self, node: &TreeFileNode) -> Option<RecordRef> {
        match (self, node) {
            (TreeFile::Autumnal(file), TreeFileNode::Autumnal(node)) => file.kept(node),
            _ => None,
        }
    }
}

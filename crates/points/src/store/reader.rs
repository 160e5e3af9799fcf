//! Reader of point tree files.

use std::path::Path;

use super::summary::Summary;
use super::writer::{BLOCKS, Entry, NODES, SUMMARY};
use crate::attribute::{PointAttribute, RowLayout};
use crate::codec::{BlockLayout, MAX_POINTS, decode};
use crate::grid::PointGrid;
use crate::query::Selection;
use crate::statistics::{Statistics, statistics_bytes};
use spinney_base::Result;
use spinney_base::io::{FileAccess, ReadBackend};
use spinney_base::space::{Code, Dimension};
use spinney_container::{BlockFile, Content, List, Metadata, OpenOptions};
use spinney_crs::{Coordinates, WorldLocator};

/// Point tree in a file.
pub struct PointTree {
    file: BlockFile,
    summary: Summary,
    grid: PointGrid,
    layout: RowLayout,
    block: BlockLayout,
    blocks: List,
    nodes: List,
}

/// Returns whether a file is a point tree, regardless of its name.
///
/// # Errors
/// If the file system or the remote host fails.
pub fn is_point_file(path: &Path, access: &FileAccess) -> Result<bool> {
    BlockFile::has_content(path, Content::Points, access)
}

/// Node of a point tree.
#[derive(Clone, Debug)]
pub(crate) struct PointNode {
    /// Index in the node list.
    pub index: usize,
    pub code: Code,
    pub statistics: Statistics,
}

impl PointTree {
    /// Opens a file.
    ///
    /// # Errors
    /// If it cannot be read, is no point tree, or is corrupt.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<PointTree> {
        PointTree::from_backend(path, options.open(path)?, options)
    }

    /// Opens a file in memory.
    ///
    /// # Errors
    /// Those of [`PointTree::open`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<PointTree> {
        PointTree::from_backend(Path::new("(memory)"), Box::new(bytes), &OpenOptions::default())
    }

    /// Opens a file through a backend; `path` is for messages.
    ///
    /// # Errors
    /// Those of [`PointTree::open`].
    pub fn from_backend(
        path: &Path,
        backend: Box<dyn ReadBackend>,
        options: &OpenOptions,
    ) -> Result<PointTree> {
        let file = BlockFile::open(path, backend, (Content::Points, "a tree of points"), options)?;
        let section = file.section(SUMMARY, "points")?;
        let (summary, grid, layout) = Summary::from_bytes(path, &section, file.header().dimension)?;
        let block = BlockLayout::of(&layout);
        let blocks = file.list(BLOCKS, "list of blocks", Entry::BYTES)?;
        let nodes = file.list(NODES, "list of nodes", 8 + statistics_bytes(block.columns))?;
        file.check_nodes(&nodes, (grid.dimension, grid.deepest()))?;
        file.check_keys(&blocks, &nodes)?;
        file.check_blocks(&[("block", &blocks, MAX_POINTS)], file.end(BLOCKS))?;
        Ok(PointTree { file, summary, grid, layout, block, blocks, nodes })
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// Returns coordinate system, provenance and tags.
    pub fn metadata(&self) -> &Metadata {
        self.file.metadata()
    }

    /// Returns the grid of the points.
    pub fn grid(&self) -> &PointGrid {
        &self.grid
    }

    /// Returns the row layout of coordinates and attributes.
    pub fn layout(&self) -> &RowLayout {
        &self.layout
    }

    /// Returns the description of the points.
    pub(crate) fn summary(&self) -> &Summary {
        &self.summary
    }

    /// Returns the attributes of the points.
    pub fn attributes(&self) -> &[PointAttribute] {
        &self.layout.attributes
    }

    /// Returns the number of points.
    pub fn len(&self) -> u64 {
        self.summary.points
    }

    /// Returns whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.summary.points == 0
    }

    /// Returns the number of points that repeat the position of another one: per position, all but
    /// one.
    pub fn duplicates(&self) -> u64 {
        self.summary.duplicates
    }

    /// Returns the maximum number of points of a node without children.
    pub fn leaf_size(&self) -> u32 {
        self.summary.leaf_size
    }

    /// Returns the deepest level of nodes.
    pub fn depth(&self) -> u8 {
        let level = |index| (self.nodes.code(self.file.backend(), index) & 31) as u8;
        (0..self.nodes.len()).map(level).max().unwrap_or(0)
    }

    /// Returns the size of the file in bytes.
    pub fn bytes(&self) -> u64 {
        self.file.bytes()
    }

    /// Returns the numbers of nodes and blocks.
    pub fn counts(&self) -> (usize, usize) {
        (self.nodes.len(), self.blocks.len())
    }

    /// Returns the number of columns: x, y, z and the attributes.
    pub(crate) fn columns(&self) -> usize {
        self.block.columns
    }

    /// Returns the node at an index of the list.
    pub(crate) fn node(&self, index: usize) -> Result<PointNode> {
        let entry = self.nodes.get(self.file.backend(), index);
        let code =
            |bytes: &[u8]| Code::from_bits(self.grid.dimension, u64::from_le_bytes(*bytes.first_chunk()?));
        let found = entry.and_then(|entry| Some((code(entry)?, &entry[8..])));
        let Some((code, rest)) = found else {
            let place = format!("node {index}");
            return Err(self.file.corrupt(place, "the end of the file", "a node"));
        };
        Ok(PointNode { index, code, statistics: Statistics::read(rest) })
    }

    /// Returns the root; `None` if there are no points.
    pub(crate) fn root(&self) -> Result<Option<PointNode>> {
        let root = if self.nodes.is_empty() { None } else { Some(self.node(0)?) };
        // The root of a small tree may be at any level.
        Ok(root)
    }

    /// Returns the children of a node, in order.
    pub(crate) fn children(&self, node: &PointNode) -> Result<Vec<PointNode>> {
        let children = self.file.children(&self.nodes, (node.index, node.code), self.grid.deepest());
        children.into_iter().map(|child| self.node(child)).collect()
    }

    /// Returns the list entry of a block.
    pub(crate) fn entry(&self, index: usize) -> Entry {
        Entry::from_bytes(self.file.entry(&self.blocks, index))
    }

    /// Returns the range of a node's blocks.
    pub(crate) fn blocks_of(&self, code: Code) -> std::ops::Range<usize> {
        self.file.blocks_of(&self.blocks, code)
    }

    /// Decodes the requested columns of a block; the others are empty.
    pub(crate) fn block(&self, index: usize, wanted: &[bool]) -> Result<Vec<Vec<i64>>> {
        let entry = self.entry(index);
        let place = format!("block {index}");
        let bytes = self.file.block(&place, &entry.block)?;
        decode(&bytes, entry.block.count as usize, &self.block, wanted)
            .ok_or_else(|| self.file.corrupt(place, "bytes that do not decode", "compressed columns"))
    }

    /// Returns the conversion from some coordinates to those of the points.
    ///
    /// # Errors
    /// Those of [`WorldLocator::new`], or if the file is corrupt.
    pub fn locator(&self, coordinates: &Coordinates) -> Result<WorldLocator> {
        let columns = self.statistics(&Selection::default(), &())?.columns;
        let ends = |axis: usize| columns[axis].map_or([0.0; 2], |found| [found.min, found.max]);
        let (x, y) = (ends(0), ends(1));
        let step = self.grid.scale[0].max(self.grid.scale[1]);
        let crs = self.metadata().frame.crs.as_ref();
        WorldLocator::new(coordinates, crs, [[x[0], y[0]], [x[1], y[1]]], step)
    }

    /// Returns the dimension; a quadtree divides x and y only.
    pub fn dimension(&self) -> Dimension {
        self.grid.dimension
    }
}

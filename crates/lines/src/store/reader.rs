//! Reader of files with trees of lines.

use std::path::Path;

use super::summary::Summary;
use super::writer::{BLOCKS, Entry, FEATURES, NODE_ENTRY, NODES, SUMMARY};
use crate::attribute::LineAttribute;
use crate::codec::{LineSegment, MAX_FEATURES, MAX_SEGMENTS, decode_features, decode_segments};
use crate::grid::LineGrid;
use crate::source::LineFeature;
use spinney_base::Result;
use spinney_base::io::{FileAccess, ReadBackend};
use spinney_base::space::Code;
use spinney_container::{BlockFile, BlockLocation, Content, List, Metadata, OpenOptions};
use spinney_crs::{Coordinates, WorldLocator};

/// Tree of lines in a file.
pub struct LineTree {
    file: BlockFile,
    summary: Summary,
    grid: LineGrid,
    attributes: Vec<LineAttribute>,
    blocks: List,
    nodes: List,
    features: List,
}

/// Returns whether a file is a tree of lines, regardless of its name.
///
/// # Errors
/// If the file system or the host of the file fails.
pub fn is_line_file(path: &Path, access: &FileAccess) -> Result<bool> {
    BlockFile::has_content(path, Content::Lines, access)
}

/// Node of a tree of lines.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LineNode {
    /// Index in the list of nodes.
    pub index: usize,
    pub code: Code,
    /// Number of segments in its subtree, and number of their features.
    pub segments: u64,
    pub features: u64,
    pub length: f64,
    pub bounds: [[i32; 3]; 2],
}

impl LineTree {
    /// Opens a file.
    ///
    /// # Errors
    /// If it cannot be read, is not a tree of lines, or is corrupt.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<LineTree> {
        LineTree::from_backend(path, options.open(path)?, options)
    }

    /// Opens a file in memory.
    ///
    /// # Errors
    /// Those of [`LineTree::open`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<LineTree> {
        LineTree::from_backend(Path::new("(memory)"), Box::new(bytes), &OpenOptions::default())
    }

    /// Opens a file through a backend; `path` is for messages.
    ///
    /// # Errors
    /// Those of [`LineTree::open`].
    pub fn from_backend(
        path: &Path,
        backend: Box<dyn ReadBackend>,
        options: &OpenOptions,
    ) -> Result<LineTree> {
        let file = BlockFile::open(path, backend, (Content::Lines, "a tree of lines"), options)?;
        let dimension = file.header().dimension;
        let (summary, grid, attributes) =
            Summary::from_bytes(path, &file.section(SUMMARY, "lines")?, dimension)?;
        let blocks = file.list(BLOCKS, "list of blocks", Entry::BYTES)?;
        let nodes = file.list(NODES, "list of nodes", NODE_ENTRY)?;
        let features = file.list(FEATURES, "list of features", Entry::BYTES)?;
        file.check_nodes(&nodes, (dimension, grid.deepest()))?;
        file.check_keys(&blocks, &nodes)?;
        let lists = [("block", &blocks, MAX_SEGMENTS), ("block of features", &features, MAX_FEATURES)];
        file.check_blocks(&lists, file.end(BLOCKS))?;
        let tree = LineTree { file, summary, grid, attributes, blocks, nodes, features };
        tree.check_feature_numbers()?;
        Ok(tree)
    }

    /// Checks that the blocks of features cover all features, in order.
    fn check_feature_numbers(&self) -> Result<()> {
        let mut next = 0u64;
        for index in 0..self.features.len() {
            let BlockLocation { key, count, .. } = self.feature_entry(index).block;
            if key != next {
                let (place, found) = (format!("block of features {index}"), format!("feature {key}"));
                return Err(self.file.corrupt(place, found, "consecutive feature numbers"));
            }
            next += u64::from(count);
        }
        if next != self.summary.features {
            let expected = self.summary.features.to_string();
            return Err(self.file.corrupt("list of features", format!("{next} features"), expected));
        }
        Ok(())
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        self.file.path()
    }

    /// Returns the coordinate system, provenance and tags.
    pub fn metadata(&self) -> &Metadata {
        self.file.metadata()
    }

    /// Returns the grid of vertices.
    pub fn grid(&self) -> &LineGrid {
        &self.grid
    }

    /// Returns the attributes of features.
    pub fn attributes(&self) -> &[LineAttribute] {
        &self.attributes
    }

    /// Returns the number of features.
    pub fn len(&self) -> u64 {
        self.summary.features
    }

    /// Returns whether there are no features.
    pub fn is_empty(&self) -> bool {
        self.summary.features == 0
    }

    /// Returns the number of line segments.
    pub fn segments(&self) -> u64 {
        self.summary.segments
    }

    /// Returns the maximum number of segments in a leaf node.
    pub fn leaf_size(&self) -> u32 {
        self.summary.leaf_size
    }

    /// Returns the file size in bytes.
    pub fn bytes(&self) -> u64 {
        self.file.bytes()
    }

    /// Returns the number of nodes, of blocks of segments, and of blocks of features.
    pub fn counts(&self) -> (usize, usize, usize) {
        (self.nodes.len(), self.blocks.len(), self.features.len())
    }

    /// Returns the minimum and maximum corner of all lines, in the world; `None` if there are no
    /// lines. With two axes, z is 0.
    ///
    /// # Errors
    /// If the file is corrupt.
    pub fn bounds(&self) -> Result<Option<[[f64; 3]; 2]>> {
        let root = self.root()?;
        Ok(root.map(|root| root.bounds.map(|corner| self.grid.to_world(corner))))
    }

    /// Returns the transformation from `coordinates` to those of the lines.
    ///
    /// # Errors
    /// Those of [`WorldLocator::new`], or if the file is corrupt.
    pub fn locator(&self, coordinates: &Coordinates) -> Result<WorldLocator> {
        let bounds = self.bounds()?.unwrap_or_default().map(|[x, y, _]| [x, y]);
        WorldLocator::new(coordinates, self.metadata().frame.crs.as_ref(), bounds, self.grid.scale[0])
    }

    /// Node at an index of the list.
    pub(crate) fn node(&self, index: usize) -> Result<LineNode> {
        let entry =
            self.nodes.get(self.file.backend(), index).and_then(|entry| entry.first_chunk::<NODE_ENTRY>());
        let eight =
            |at: usize| entry.map(|bytes| u64::from_le_bytes(std::array::from_fn(|byte| bytes[at + byte])));
        let four = |at: usize| {
            entry.map_or(0, |bytes| i32::from_le_bytes(std::array::from_fn(|byte| bytes[at + byte])))
        };
        let code = eight(0).and_then(|code| Code::from_bits(self.grid.dimension, code));
        let (Some(code), Some(segments), Some(features), Some(length)) =
            (code, eight(8), eight(16), eight(24))
        else {
            let place = format!("node {index}");
            return Err(self.file.corrupt(place, "the end of the file", "a node"));
        };
        let corner = |at: usize| std::array::from_fn(|axis| four(at + 4 * axis));
        let bounds = [corner(32), corner(44)];
        Ok(LineNode { index, code, segments, features, length: f64::from_bits(length), bounds })
    }

    /// Root, or in a small tree the topmost node; `None` if there are no lines.
    pub(crate) fn root(&self) -> Result<Option<LineNode>> {
        if self.nodes.is_empty() { Ok(None) } else { self.node(0).map(Some) }
    }

    /// Children of a node, in order.
    pub(crate) fn children(&self, node: &LineNode) -> Result<Vec<LineNode>> {
        let children = self.file.children(&self.nodes, (node.index, node.code), self.grid.deepest());
        children.into_iter().map(|child| self.node(child)).collect()
    }

    /// Entry of a block of segments.
    pub(crate) fn block_entry(&self, index: usize) -> Entry {
        Entry::from_bytes(self.file.entry(&self.blocks, index))
    }

    /// Entry of a block of features.
    pub(crate) fn feature_entry(&self, index: usize) -> Entry {
        Entry::from_bytes(self.file.entry(&self.features, index))
    }

    /// Index of the block of features that contains a feature.
    pub(crate) fn feature_block_of(&self, feature: u64) -> usize {
        self.features.find(self.file.backend(), 0, feature.saturating_add(1)).saturating_sub(1)
    }

    /// Indices of a node's blocks.
    pub(crate) fn blocks_of(&self, code: Code) -> std::ops::Range<usize> {
        self.file.blocks_of(&self.blocks, code)
    }

    /// Segments of a block.
    pub(crate) fn block(&self, index: usize) -> Result<Vec<LineSegment>> {
        let entry = self.block_entry(index);
        let place = format!("block {index}");
        let bytes = self.file.block(&place, &entry.block)?;
        decode_segments(&bytes, entry.block.count as usize, self.grid.axes())
            .ok_or_else(|| self.file.corrupt(place, "bytes that do not decode", "compressed segments"))
    }

    /// Features of a block.
    pub(crate) fn feature_block(&self, index: usize) -> Result<Vec<LineFeature>> {
        let entry = self.feature_entry(index);
        let place = format!("block of features {index}");
        let bytes = self.file.block(&place, &entry.block)?;
        decode_features(&bytes, entry.block.count as usize, self.attributes.len(), self.grid.axes())
            .ok_or_else(|| self.file.corrupt(place, "bytes that do not decode", "compressed features"))
    }

    /// Calls `each` for features by their numbers, from 0, which must ascend. Stops at the first
    /// number that is out of range.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read, and those of `each`.
    pub fn features(
        &self,
        numbers: &mut dyn Iterator<Item = u64>,
        each: &mut dyn FnMut(u64, &LineFeature) -> Result<()>,
    ) -> Result<()> {
        let mut held: Option<(usize, u64, Vec<LineFeature>)> = None;
        for number in numbers.take_while(|number| *number < self.len()) {
            let block = self.feature_block_of(number);
            if held.as_ref().is_none_or(|(own, ..)| *own != block) {
                held = Some((block, self.feature_entry(block).block.key, self.feature_block(block)?));
            }
            let found = held.as_ref().and_then(|(_, first, features)| {
                features.get(usize::try_from(number.checked_sub(*first)?).ok()?)
            });
            if let Some(feature) = found {
                each(number, feature)?;
            }
        }
        Ok(())
    }
}

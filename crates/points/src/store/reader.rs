//! Reads files of trees of points.

use std::path::{Path, PathBuf};

use super::summary::Summary;
use super::writer::{BLOCK_ENTRY, BLOCKS, BlockEntry, METADATA, NODES, SUMMARY};
use crate::attribute::{PointAttribute, RowLayout};
use crate::codec::{BlockLayout, MOST_POINTS, decode};
use crate::grid::PointGrid;
use crate::statistics::{Statistics, statistics_bytes};
use spinney_base::io::{FileBytes, ReadBackend, open_file, with_cache};
use spinney_base::space::{Code, Dimension};
use spinney_base::{Error, Result};
use spinney_container::{Content, FileHeader, HEADER_SIZE, List, Metadata, OpenOptions, TAIL, Trailer};

/// A tree of points in a file.
pub struct PointTree {
    path: PathBuf,
    backend: Box<dyn ReadBackend>,
    metadata: Metadata,
    summary: Summary,
    grid: PointGrid,
    layout: RowLayout,
    block: BlockLayout,
    blocks: List,
    nodes: List,
    check: bool,
    bytes: u64,
}

/// Whether a file is a tree of points, whatever its name.
pub fn is_point_file(path: &Path) -> bool {
    open_file(path, true, &[]).and_then(|(file, _)| header(path, &*file)).is_ok()
}

/// Reads and checks the header of a file of points.
fn header(path: &Path, file: &dyn ReadBackend) -> Result<FileHeader> {
    let header = FileHeader::read(path, file)?;
    match header.content {
        Content::Points => Ok(header),
        _ => Err(Error::corrupt(path, "header", "a file of other content", "a tree of points")),
    }
}

/// A node of a tree of points.
#[derive(Clone, Debug)]
pub(crate) struct PointNode {
    /// Its place in the list.
    pub index: usize,
    pub code: Code,
    pub statistics: Statistics,
}

impl PointTree {
    /// Opens a file.
    ///
    /// # Errors
    /// If it cannot be read, is no tree of points, or is damaged.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<PointTree> {
        PointTree::from_backend(path, options.open(path)?, options)
    }

    /// Opens a file that is in memory.
    ///
    /// # Errors
    /// Those of [`PointTree::open`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<PointTree> {
        PointTree::from_backend(Path::new("(memory)"), Box::new(bytes), &OpenOptions::default())
    }

    /// Opens whatever a backend reads; `path` is for messages.
    ///
    /// # Errors
    /// Those of [`PointTree::open`].
    pub fn from_backend(
        path: &Path,
        backend: Box<dyn ReadBackend>,
        options: &OpenOptions,
    ) -> Result<PointTree> {
        let backend = with_cache(backend, options.cache);
        let header = header(path, &*backend)?;
        let length = backend.len();
        let tail = length.min(TAIL as u64);
        let trailer = Trailer::from_bytes(path, &backend.read(length - tail, tail as usize)?, length)?;
        if trailer.header != header {
            return Err(Error::corrupt(path, "trailer", "another header", "the file's own"));
        }
        Metadata::check_length(path, trailer.section(METADATA).length)?;
        let metadata =
            Metadata::from_bytes(path, &trailer.section(METADATA).read(path, &*backend, "metadata")?)?;
        Metadata::check_length(path, trailer.section(SUMMARY).length)?;
        let bytes = trailer.section(SUMMARY).read(path, &*backend, "points")?;
        let (summary, grid, layout) = Summary::from_bytes(path, &bytes, header.dimension)?;
        let block = BlockLayout::of(&layout);
        let entry = 8 + statistics_bytes(block.columns);
        let blocks = List::open(path, &*backend, (trailer.section(BLOCKS), "list of blocks"), BLOCK_ENTRY)?;
        let nodes = List::open(path, &*backend, (trailer.section(NODES), "list of nodes"), entry)?;
        let end = trailer.section(BLOCKS).offset;
        let path = path.to_path_buf();
        let bytes = length;
        let tree = PointTree {
            path,
            backend,
            metadata,
            summary,
            grid,
            layout,
            block,
            blocks,
            nodes,
            check: options.check,
            bytes,
        };
        tree.check_lists(end)?;
        Ok(tree)
    }

    /// Checks that nodes ascend, and that their blocks are in the file, each once.
    fn check_lists(&self, end: u64) -> Result<()> {
        let corrupt = |place: String, found: String, expected: &str| {
            Err(Error::corrupt(&self.path, place, found, expected))
        };
        let mut before = None;
        for index in 0..self.nodes.len() {
            let code = self.nodes.code(&*self.backend, index);
            let fits = Code::from_bits(self.grid.dimension, code)
                .is_some_and(|code| code.level() <= self.grid.deepest());
            if before.is_some_and(|before| before >= code) || !fits {
                return corrupt(
                    format!("node {index}"),
                    format!("code {code:x}"),
                    "codes of the tree that ascend",
                );
            }
            before = Some(code);
        }
        let (mut sum, mut node) = (0u64, 0);
        for index in 0..self.blocks.len() {
            let entry = self.entry(index);
            node = self.nodes.find(&*self.backend, node, entry.code);
            if self.nodes.code(&*self.backend, node) != entry.code {
                return corrupt(
                    format!("block {index}"),
                    format!("code {:x}", entry.code),
                    "codes of nodes, in order",
                );
            }
            let range = entry.offset.checked_add(entry.length.into());
            let is_inside = range.is_some_and(|last| entry.offset >= HEADER_SIZE as u64 && last <= end);
            if !is_inside || !(1..=MOST_POINTS as u32).contains(&entry.points) {
                let found = format!("{} points in bytes {} + {}", entry.points, entry.offset, entry.length);
                return corrupt(format!("block {index}"), found, "points in bytes before the lists");
            }
            // (Fewer than 2^32 of them, of less than 2^32 each.)
            sum += u64::from(entry.length);
        }
        // Blocks that are stored once each: the work of going through all of them goes with the file's size.
        if sum > end {
            return corrupt(
                "list of blocks".into(),
                format!("{sum} bytes of blocks"),
                &format!("at most {end}"),
            );
        }
        Ok(())
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Coordinate system, provenance and tags.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The grid that the points lie on.
    pub fn grid(&self) -> &PointGrid {
        &self.grid
    }

    /// Rows of the points' coordinates and attributes.
    pub fn layout(&self) -> &RowLayout {
        &self.layout
    }

    /// The attributes of points.
    pub fn attributes(&self) -> &[PointAttribute] {
        &self.layout.attributes
    }

    /// Number of points.
    pub fn len(&self) -> u64 {
        self.summary.points
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.summary.points == 0
    }

    /// Number of points at the place of another one: for each place, all but one.
    pub fn duplicates(&self) -> u64 {
        self.summary.duplicates
    }

    /// Points of a node without nodes below, at most.
    pub fn leaf_size(&self) -> u32 {
        self.summary.leaf_size
    }

    /// The deepest level that nodes have.
    pub fn depth(&self) -> u8 {
        let level = |index| (self.nodes.code(&*self.backend, index) & 31) as u8;
        (0..self.nodes.len()).map(level).max().unwrap_or(0)
    }

    /// Bytes of the file.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Number of nodes, and of blocks.
    pub fn counts(&self) -> (usize, usize) {
        (self.nodes.len(), self.blocks.len())
    }

    /// Numbers of columns: x, y, z, then the attributes.
    pub(crate) fn columns(&self) -> usize {
        self.block.columns
    }

    /// The node in a place of the list.
    pub(crate) fn node(&self, index: usize) -> Result<PointNode> {
        let entry = self.nodes.get(&*self.backend, index);
        let code =
            |bytes: &[u8]| Code::from_bits(self.grid.dimension, u64::from_le_bytes(*bytes.first_chunk()?));
        let found = entry.and_then(|entry| Some((code(entry)?, &entry[8..])));
        let Some((code, rest)) = found else {
            let place = format!("node {index}");
            return Err(Error::corrupt(&self.path, place, "no node", "a file that nobody cuts short"));
        };
        Ok(PointNode { index, code, statistics: Statistics::read(rest) })
    }

    /// The root; `None` if there are no points.
    pub(crate) fn root(&self) -> Result<Option<PointNode>> {
        let root = if self.nodes.is_empty() { None } else { Some(self.node(0)?) };
        // (A small tree has its points in a node of any level.)
        Ok(root)
    }

    /// The children that a node has, in order.
    pub(crate) fn children(&self, node: &PointNode) -> Result<Vec<PointNode>> {
        let mut children = Vec::new();
        let mut from = node.index + 1;
        if node.code.level() >= self.grid.deepest() {
            return Ok(children);
        }
        for child in 0..self.grid.dimension.children() {
            let code = node.code.child(child);
            from = self.nodes.find(&*self.backend, from, code.bits());
            if self.nodes.code(&*self.backend, from) == code.bits() {
                children.push(self.node(from)?);
            }
        }
        Ok(children)
    }

    pub(crate) fn entry(&self, index: usize) -> BlockEntry {
        let none = [0; BLOCK_ENTRY];
        BlockEntry::from_bytes(self.blocks.get(&*self.backend, index).unwrap_or(&none))
    }

    /// The blocks of a node.
    pub(crate) fn blocks_of(&self, code: Code) -> std::ops::Range<usize> {
        let first = self.blocks.find(&*self.backend, 0, code.bits());
        first..self.blocks.find(&*self.backend, first, code.bits() + 1)
    }

    /// The bytes of a block, with the right checksum.
    fn block_bytes(&self, index: usize, entry: &BlockEntry) -> Result<FileBytes<'_>> {
        let corrupt = |found: String, expected: &str| {
            Err(Error::corrupt(&self.path, format!("block {index}"), found, expected))
        };
        if entry.offset + u64::from(entry.length) > self.backend.len() {
            return corrupt("no bytes".into(), "a file that nobody cuts short");
        }
        let bytes = self.backend.share(entry.offset, entry.length as usize)?;
        if self.check {
            let found = crc32c::crc32c(&bytes);
            if found != entry.checksum {
                return corrupt(format!("checksum {found:08x}"), &format!("{:08x}", entry.checksum));
            }
        }
        Ok(bytes)
    }

    /// The columns of a block that are asked for; the others are empty.
    pub(crate) fn block(&self, index: usize, wanted: &[bool]) -> Result<Vec<Vec<i64>>> {
        let entry = self.entry(index);
        let bytes = self.block_bytes(index, &entry)?;
        decode(&bytes, entry.points as usize, &self.block, wanted).ok_or_else(|| {
            Error::corrupt(
                &self.path,
                format!("block {index}"),
                "bytes that no columns have",
                "columns that were packed",
            )
        })
    }

    /// Whether the tree divides x and y only.
    pub fn dimension(&self) -> Dimension {
        self.grid.dimension
    }
}

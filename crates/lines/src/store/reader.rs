//! Reads files of trees of lines.

use std::path::{Path, PathBuf};

use super::summary::Summary;
use super::writer::{BLOCK_ENTRY, BLOCKS, Entry, FEATURES, METADATA, NODE_ENTRY, NODES, SUMMARY};
use crate::attribute::LineAttribute;
use crate::codec::{MOST_FEATURES, MOST_SEGMENTS, Piece, decode_features, decode_segments};
use crate::grid::LineGrid;
use crate::source::LineFeature;
use spinney_base::io::{FileBytes, ReadBackend, open_file, with_cache};
use spinney_base::space::{Code, Dimension};
use spinney_base::{Error, Result};
use spinney_container::{Content, FileHeader, HEADER_SIZE, List, Metadata, OpenOptions, TAIL, Trailer};

/// A tree of lines in a file.
pub struct LineTree {
    path: PathBuf,
    backend: Box<dyn ReadBackend>,
    metadata: Metadata,
    summary: Summary,
    grid: LineGrid,
    attributes: Vec<LineAttribute>,
    blocks: List,
    nodes: List,
    features: List,
    check: bool,
    bytes: u64,
}

/// Whether a file is a tree of lines, whatever its name.
pub fn is_line_file(path: &Path) -> bool {
    open_file(path, true, &[]).and_then(|(file, _)| header(path, &*file)).is_ok()
}

/// Reads and checks the header of a file of lines.
fn header(path: &Path, file: &dyn ReadBackend) -> Result<FileHeader> {
    let header = FileHeader::read(path, file)?;
    match (header.content, header.dimension) {
        (Content::Lines, Dimension::Quad) => Ok(header),
        _ => Err(Error::corrupt(path, "header", "a file of other content", "a quadtree of lines")),
    }
}

/// A node of a tree of lines.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LineNode {
    /// Its place in the list.
    pub index: usize,
    pub code: Code,
    /// Number of pieces in it and below, and of features that these are of.
    pub segments: u64,
    pub features: u64,
    pub length: f64,
    pub bounds: [[i32; 2]; 2],
}

impl LineTree {
    /// Opens a file.
    ///
    /// # Errors
    /// If it cannot be read, is no tree of lines, or is damaged.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<LineTree> {
        LineTree::from_backend(path, options.open(path)?, options)
    }

    /// Opens a file that is in memory.
    ///
    /// # Errors
    /// Those of [`LineTree::open`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<LineTree> {
        LineTree::from_backend(Path::new("(memory)"), Box::new(bytes), &OpenOptions::default())
    }

    /// Opens whatever a backend reads; `path` is for messages.
    ///
    /// # Errors
    /// Those of [`LineTree::open`].
    pub fn from_backend(
        path: &Path,
        backend: Box<dyn ReadBackend>,
        options: &OpenOptions,
    ) -> Result<LineTree> {
        let backend = with_cache(backend, options.cache);
        let header = header(path, &*backend)?;
        let bytes = backend.len();
        let tail = bytes.min(TAIL as u64);
        let trailer = Trailer::from_bytes(path, &backend.read(bytes - tail, tail as usize)?, bytes)?;
        if trailer.header != header {
            return Err(Error::corrupt(path, "trailer", "another header", "the file's own"));
        }
        Metadata::check_length(path, trailer.section(METADATA).length)?;
        let metadata =
            Metadata::from_bytes(path, &trailer.section(METADATA).read(path, &*backend, "metadata")?)?;
        Metadata::check_length(path, trailer.section(SUMMARY).length)?;
        let section = trailer.section(SUMMARY).read(path, &*backend, "lines")?;
        let (summary, grid, attributes) = Summary::from_bytes(path, &section)?;
        let list = |tag, name: &str, entry| List::open(path, &*backend, (trailer.section(tag), name), entry);
        let blocks = list(BLOCKS, "list of blocks", BLOCK_ENTRY)?;
        let nodes = list(NODES, "list of nodes", NODE_ENTRY)?;
        let features = list(FEATURES, "list of features", BLOCK_ENTRY)?;
        let end = trailer.section(BLOCKS).offset;
        let (path, check) = (path.to_path_buf(), options.check);
        let tree = LineTree {
            path,
            backend,
            metadata,
            summary,
            grid,
            attributes,
            blocks,
            nodes,
            features,
            check,
            bytes,
        };
        tree.check_lists(end)?;
        Ok(tree)
    }

    /// Checks that nodes ascend, that blocks are in the file, each once, and that there is one for each feature.
    fn check_lists(&self, end: u64) -> Result<()> {
        let corrupt = |place: String, found: String, expected: &str| {
            Err(Error::corrupt(&self.path, place, found, expected))
        };
        let mut before: Option<u64> = None;
        for index in 0..self.nodes.len() {
            let code = self.nodes.code(&*self.backend, index);
            let fits = Code::from_bits(Dimension::Quad, code)
                .is_some_and(|code| code.level() <= self.grid.deepest());
            if before.is_some_and(|before| before >= code) || !fits {
                let expected = "codes of the tree that ascend";
                return corrupt(format!("node {index}"), format!("code {code:x}"), expected);
            }
            before = Some(code);
        }
        let (mut sum, mut node, mut next) = (0u64, 0, 0u64);
        for (list, most) in [(&self.blocks, MOST_SEGMENTS), (&self.features, MOST_FEATURES)] {
            let is_of_features = most == MOST_FEATURES;
            for index in 0..list.len() {
                let entry = self.entry(list, index);
                let place = if is_of_features { "block of features" } else { "block" };
                let place = format!("{place} {index}");
                if is_of_features {
                    if entry.key != next {
                        return corrupt(
                            place,
                            format!("feature {}", entry.key),
                            "numbers that follow each other",
                        );
                    }
                    next += u64::from(entry.count);
                } else {
                    node = self.nodes.find(&*self.backend, node, entry.key);
                    if self.nodes.code(&*self.backend, node) != entry.key {
                        return corrupt(place, format!("code {:x}", entry.key), "codes of nodes, in order");
                    }
                }
                let range = entry.offset.checked_add(entry.length.into());
                let is_inside = range.is_some_and(|last| entry.offset >= HEADER_SIZE as u64 && last <= end);
                if !is_inside || !(1..=most as u32).contains(&entry.count) {
                    let found = format!("{} in bytes {} + {}", entry.count, entry.offset, entry.length);
                    return corrupt(place, found, "some in bytes before the lists");
                }
                sum += u64::from(entry.length);
            }
        }
        // Blocks that are stored once each: the work of going through all of them goes with the file's size.
        if sum > end {
            return corrupt("lists of blocks".into(), format!("{sum} bytes"), &format!("at most {end}"));
        }
        if next != self.summary.features {
            let expected = format!("{}", self.summary.features);
            return corrupt("list of features".into(), format!("{next} features"), &expected);
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

    /// The grid that vertices lie on.
    pub fn grid(&self) -> &LineGrid {
        &self.grid
    }

    /// The attributes of features.
    pub fn attributes(&self) -> &[LineAttribute] {
        &self.attributes
    }

    /// Number of features.
    pub fn len(&self) -> u64 {
        self.summary.features
    }

    /// Whether there are no features.
    pub fn is_empty(&self) -> bool {
        self.summary.features == 0
    }

    /// Number of pieces of lines.
    pub fn segments(&self) -> u64 {
        self.summary.segments
    }

    /// Pieces of a node without nodes below, at most.
    pub fn leaf_size(&self) -> u32 {
        self.summary.leaf_size
    }

    /// Bytes of the file.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Number of nodes, of blocks of pieces, and of blocks of features.
    pub fn counts(&self) -> (usize, usize, usize) {
        (self.nodes.len(), self.blocks.len(), self.features.len())
    }

    /// Least and greatest corner of all lines, in the world; `None` if there are none.
    ///
    /// # Errors
    /// If the file is damaged.
    pub fn bounds(&self) -> Result<Option<[[f64; 2]; 2]>> {
        let root = self.root()?;
        Ok(root.map(|root| root.bounds.map(|corner| self.grid.to_world(corner))))
    }

    /// The node in a place of the list.
    pub(crate) fn node(&self, index: usize) -> Result<LineNode> {
        let entry = self.nodes.get(&*self.backend, index).and_then(|entry| entry.first_chunk::<NODE_ENTRY>());
        let eight =
            |at: usize| entry.map(|bytes| u64::from_le_bytes(std::array::from_fn(|byte| bytes[at + byte])));
        let four = |at: usize| {
            entry.map_or(0, |bytes| i32::from_le_bytes(std::array::from_fn(|byte| bytes[at + byte])))
        };
        let code = eight(0).and_then(|code| Code::from_bits(Dimension::Quad, code));
        let (Some(code), Some(segments), Some(features), Some(length)) =
            (code, eight(8), eight(16), eight(24))
        else {
            let place = format!("node {index}");
            return Err(Error::corrupt(&self.path, place, "no node", "a file that nobody cuts short"));
        };
        let bounds = [[four(32), four(36)], [four(40), four(44)]];
        Ok(LineNode { index, code, segments, features, length: f64::from_bits(length), bounds })
    }

    /// The root, or what stands for it in a small tree; `None` if there are no lines.
    pub(crate) fn root(&self) -> Result<Option<LineNode>> {
        if self.nodes.is_empty() { Ok(None) } else { self.node(0).map(Some) }
    }

    /// The children that a node has, in order.
    pub(crate) fn children(&self, node: &LineNode) -> Result<Vec<LineNode>> {
        let mut children = Vec::new();
        let mut from = node.index + 1;
        if node.code.level() >= self.grid.deepest() {
            return Ok(children);
        }
        for child in 0..Dimension::Quad.children() {
            let code = node.code.child(child);
            from = self.nodes.find(&*self.backend, from, code.bits());
            if self.nodes.code(&*self.backend, from) == code.bits() {
                children.push(self.node(from)?);
            }
        }
        Ok(children)
    }

    fn entry(&self, list: &List, index: usize) -> Entry {
        let bytes = list.get(&*self.backend, index).and_then(|entry| entry.first_chunk::<BLOCK_ENTRY>());
        Entry::from_bytes(bytes.unwrap_or(&[0; BLOCK_ENTRY]))
    }

    /// The entry of a block of pieces.
    pub(crate) fn block_entry(&self, index: usize) -> Entry {
        self.entry(&self.blocks, index)
    }

    /// The entry of a block of features.
    pub(crate) fn feature_entry(&self, index: usize) -> Entry {
        self.entry(&self.features, index)
    }

    /// The block of features that has one.
    pub(crate) fn feature_block_of(&self, feature: u64) -> usize {
        self.features.find(&*self.backend, 0, feature.saturating_add(1)).saturating_sub(1)
    }

    /// The blocks of a node.
    pub(crate) fn blocks_of(&self, code: Code) -> std::ops::Range<usize> {
        let first = self.blocks.find(&*self.backend, 0, code.bits());
        first..self.blocks.find(&*self.backend, first, code.bits() + 1)
    }

    /// The bytes of a block, with the right checksum.
    fn block_bytes(&self, place: &str, entry: &Entry) -> Result<FileBytes<'_>> {
        let corrupt = |found: String, expected: &str| Err(Error::corrupt(&self.path, place, found, expected));
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

    /// The pieces of a block.
    pub(crate) fn block(&self, index: usize) -> Result<Vec<Piece>> {
        let entry = self.block_entry(index);
        let place = format!("block {index}");
        let bytes = self.block_bytes(&place, &entry)?;
        decode_segments(&bytes, entry.count as usize)
            .ok_or_else(|| Error::corrupt(&self.path, place, "bytes that no pieces have", "pieces of lines"))
    }

    /// The features of a block.
    pub(crate) fn feature_block(&self, index: usize) -> Result<Vec<LineFeature>> {
        let entry = self.feature_entry(index);
        let place = format!("block of features {index}");
        let bytes = self.block_bytes(&place, &entry)?;
        decode_features(&bytes, entry.count as usize, self.attributes.len())
            .ok_or_else(|| Error::corrupt(&self.path, place, "bytes that no features have", "features"))
    }

    /// Hands out features by their numbers, from 0, which ascend; of those that there are not, none.
    ///
    /// # Errors
    /// If the file is damaged or cannot be read, and those of who takes them.
    pub fn features(
        &self,
        numbers: &mut dyn Iterator<Item = u64>,
        each: &mut dyn FnMut(u64, &LineFeature) -> Result<()>,
    ) -> Result<()> {
        let mut held: Option<(usize, u64, Vec<LineFeature>)> = None;
        for number in numbers.take_while(|number| *number < self.len()) {
            let block = self.feature_block_of(number);
            if held.as_ref().is_none_or(|(own, ..)| *own != block) {
                held = Some((block, self.feature_entry(block).key, self.feature_block(block)?));
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

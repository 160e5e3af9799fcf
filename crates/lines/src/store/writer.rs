//! Writes a file of a tree of lines: header, blocks as they come, lists of blocks and nodes, metadata, trailer.

use std::io::Write;
use std::path::PathBuf;

use super::summary::Summary;
use crate::grid::LineGrid;
use crate::statistics::Statistics;
use spinney_base::io::{Output, Sorter, folder};
use spinney_base::space::{Code, Dimension};
use spinney_base::{Error, Result};
use spinney_container::{Content, FileHeader, Metadata, SectionWriter, Trailer, TreeFormat, check_tree_name};

/// Tag of the list of blocks of pieces.
pub(crate) const BLOCKS: [u8; 4] = *b"LBLK";
/// Tag of the list of nodes.
pub(crate) const NODES: [u8; 4] = *b"LNOD";
/// Tag of the list of blocks of features.
pub(crate) const FEATURES: [u8; 4] = *b"LFEA";
/// Tag of the section that says what the lines are.
pub(crate) const SUMMARY: [u8; 4] = *b"LINS";
/// Tag of the metadata.
pub(crate) const METADATA: [u8; 4] = *b"META";

/// An entry of a list of blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Entry {
    /// The code of the node whose pieces these are; of features the first one's number.
    pub key: u64,
    pub offset: u64,
    pub length: u32,
    pub checksum: u32,
    /// How many pieces or features there are.
    pub count: u32,
    /// Least and greatest place on the grid.
    pub bounds: [[i32; 2]; 2],
}

/// Bytes of an entry of a list of blocks, and of nodes.
pub(crate) const BLOCK_ENTRY: usize = 44;
pub(crate) const NODE_ENTRY: usize = 48;

impl Entry {
    fn to_bytes(self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(BLOCK_ENTRY);
        bytes.extend_from_slice(&self.key.to_le_bytes());
        bytes.extend_from_slice(&self.offset.to_le_bytes());
        for number in [self.length, self.checksum, self.count] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        self.bounds.iter().flatten().for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
        bytes
    }

    pub(crate) fn from_bytes(bytes: &[u8; BLOCK_ENTRY]) -> Entry {
        let eight = |at: usize| u64::from_le_bytes(std::array::from_fn(|byte| bytes[at + byte]));
        let four = |at: usize| u32::from_le_bytes(std::array::from_fn(|byte| bytes[at + byte]));
        let place = |at: usize| [four(at) as i32, four(at + 4) as i32];
        Entry {
            key: eight(0),
            offset: eight(8),
            length: four(16),
            checksum: four(20),
            count: four(24),
            bounds: [place(28), place(36)],
        }
    }
}

/// A file being written, append-only.
pub(crate) struct LineWriter {
    out: Output,
    path: PathBuf,
    header: FileHeader,
    position: u64,
    blocks: Sorter,
    nodes: Sorter,
    features: Sorter,
}

impl LineWriter {
    /// Starts a file; about `memory` bytes hold entries of each list before they go to a temporary file.
    pub(crate) fn new(out: Output, grid: &LineGrid, memory: u64) -> Result<LineWriter> {
        let path = out.path().to_path_buf();
        check_tree_name(&path)?;
        if TreeFormat::of(&path) == TreeFormat::Autumnal {
            let advice = "name it .goblin: trees of lines are not edited";
            return Err(Error::unsupported(path, "an Autumnal file of lines", advice));
        }
        let (format, content, dimension) = (TreeFormat::Goblin, Content::Lines, Dimension::Quad);
        let header = FileHeader { format, content, dimension, depth: grid.deepest(), layers: 0 };
        let list = |entry| Sorter::new(folder(&path), entry, memory);
        let (blocks, nodes, features) = (list(BLOCK_ENTRY), list(NODE_ENTRY), list(BLOCK_ENTRY));
        let mut writer = LineWriter { out, path, header, position: 0, blocks, nodes, features };
        writer.write(&header.to_bytes(), "write the header")?;
        Ok(writer)
    }

    fn write(&mut self, bytes: &[u8], doing: &'static str) -> Result<()> {
        self.out.write_all(bytes).map_err(Error::io(&self.path, doing))?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    fn entry(&mut self, key: u64, bytes: &[u8], (count, bounds): (u64, [[i32; 2]; 2])) -> Result<Entry> {
        let offset = self.position;
        let length = u32::try_from(bytes.len()).map_err(|_| Error::TooLarge {
            path: self.path.clone(),
            what: "a feature".into(),
            needed: bytes.len() as u64,
            limit: u32::MAX.into(),
            advice: "leave it out with --where".into(),
        })?;
        self.write(bytes, "write a block of lines")?;
        Ok(Entry { key, offset, length, checksum: crc32c::crc32c(bytes), count: count as u32, bounds })
    }

    /// Writes a block of pieces of a node. Those of one node come in order.
    pub(crate) fn block(&mut self, code: Code, bytes: &[u8], statistics: &Statistics) -> Result<()> {
        let entry = self.entry(code.bits(), bytes, (statistics.segments, statistics.bounds))?;
        self.blocks.push(entry.key, entry.to_bytes())
    }

    /// Writes a block of features, of which the first has a number.
    pub(crate) fn features(&mut self, first: u64, bytes: &[u8], count: usize) -> Result<()> {
        let entry = self.entry(first, bytes, (count as u64, [[0; 2]; 2]))?;
        self.features.push(first, entry.to_bytes())
    }

    /// Notes a node, with what is known of all pieces in it and below.
    pub(crate) fn node(&mut self, code: Code, statistics: &Statistics) -> Result<()> {
        let mut bytes = Vec::with_capacity(NODE_ENTRY);
        for number in [code.bits(), statistics.segments, statistics.features(code.level())] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        bytes.extend_from_slice(&statistics.length.to_le_bytes());
        statistics.bounds.iter().flatten().for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
        self.nodes.push(code.bits(), bytes)
    }

    /// Writes what stands behind the blocks and puts the file in its place.
    pub(crate) fn finish(self, summary: &Summary, metadata: &Metadata) -> Result<()> {
        let LineWriter { mut out, path, header, mut position, blocks, nodes, features } = self;
        let (summary, metadata) = (summary.to_bytes(&path)?, metadata.to_bytes(&path)?);
        let mut sections = Vec::new();
        for (tag, list) in [(BLOCKS, blocks), (NODES, nodes), (FEATURES, features)] {
            let mut section = SectionWriter::new(&mut out, position);
            list.finish(&mut |entry| section.write_all(entry).map_err(Error::io(&path, "write a list")))?;
            position += section.written.length;
            sections.push((tag, section.written));
        }
        for (tag, bytes) in [(SUMMARY, summary), (METADATA, metadata)] {
            let mut section = SectionWriter::new(&mut out, position);
            section.write_all(&bytes).map_err(Error::io(&path, "write a section"))?;
            position += section.written.length;
            sections.push((tag, section.written));
        }
        let trailer = Trailer { header, sections };
        out.write_all(&trailer.to_bytes(position)).map_err(Error::io(&path, "write the trailer"))?;
        out.commit()
    }
}

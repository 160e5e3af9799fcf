//! Writes a file of a tree of points: header, blocks as they come, lists of blocks and nodes, metadata, trailer.

use std::io::Write;
use std::path::PathBuf;

use super::summary::Summary;
use crate::grid::PointGrid;
use crate::statistics::{Statistics, statistics_bytes};
use spinney_base::io::{Output, Sorter, folder};
use spinney_base::space::Code;
use spinney_base::{Error, Result};
use spinney_container::{
    Content, FileHeader, HEADER_SIZE, Metadata, Section, SectionWriter, Trailer, TreeFormat, check_tree_name,
};

/// Tag of the list of blocks.
pub(crate) const BLOCKS: [u8; 4] = *b"PBLK";
/// Tag of the list of nodes.
pub(crate) const NODES: [u8; 4] = *b"PNOD";
/// Tag of the section that says what the points are.
pub(crate) const SUMMARY: [u8; 4] = *b"PNTS";
/// Tag of the metadata.
pub(crate) const METADATA: [u8; 4] = *b"META";

/// An entry of the list of blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct BlockEntry {
    /// The code of the node whose points these are.
    pub code: u64,
    pub offset: u64,
    pub length: u32,
    pub checksum: u32,
    pub points: u32,
    /// Least and greatest place of the points on the grid.
    pub bounds: [[i32; 3]; 2],
}

/// Bytes of an entry of the list of blocks.
pub(crate) const BLOCK_ENTRY: usize = 52;

impl BlockEntry {
    fn to_bytes(self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(BLOCK_ENTRY);
        bytes.extend_from_slice(&self.code.to_le_bytes());
        bytes.extend_from_slice(&self.offset.to_le_bytes());
        for number in [self.length, self.checksum, self.points] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        self.bounds.iter().flatten().for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
        bytes
    }

    pub(crate) fn from_bytes(bytes: &[u8]) -> BlockEntry {
        let eight = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes"));
        let four = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
        let place = |at: usize| std::array::from_fn(|axis| four(at + 4 * axis) as i32);
        BlockEntry {
            code: eight(0),
            offset: eight(8),
            length: four(16),
            checksum: four(20),
            points: four(24),
            bounds: [place(28), place(40)],
        }
    }
}

/// A file being written, append-only.
pub(crate) struct PointWriter {
    out: Output,
    path: PathBuf,
    header: FileHeader,
    position: u64,
    blocks: Sorter,
    nodes: Sorter,
    deepest: u8,
}

impl PointWriter {
    /// Starts a file of points with so many columns; about `memory` bytes hold entries of each list before they go to a temporary file.
    pub(crate) fn new(out: Output, grid: &PointGrid, columns: usize, memory: u64) -> Result<PointWriter> {
        let path = out.path().to_path_buf();
        check_tree_name(&path)?;
        if TreeFormat::of(&path) == TreeFormat::Autumnal {
            let advice = "name it .goblin: trees of points are not edited";
            return Err(Error::unsupported(path, "an Autumnal file of points", advice));
        }
        let (format, content) = (TreeFormat::Goblin, Content::Points);
        let header =
            FileHeader { format, content, dimension: grid.dimension, depth: grid.deepest(), layers: 0 };
        let blocks = Sorter::new(folder(&path), BLOCK_ENTRY, memory);
        let nodes = Sorter::new(folder(&path), 8 + statistics_bytes(columns), memory);
        let mut writer = PointWriter { out, path, header, position: 0, blocks, nodes, deepest: 0 };
        writer.write(&header.to_bytes(), "write the header")?;
        Ok(writer)
    }

    fn write(&mut self, bytes: &[u8], doing: &'static str) -> Result<()> {
        self.out.write_all(bytes).map_err(Error::io(&self.path, doing))?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    /// Writes a block of a node. Those of one node come in order.
    pub(crate) fn block(&mut self, code: Code, bytes: &[u8], statistics: &Statistics) -> Result<()> {
        let offset = self.position;
        self.write(bytes, "write a block of points")?;
        let entry = BlockEntry {
            code: code.bits(),
            offset,
            length: bytes.len() as u32,
            checksum: crc32c::crc32c(bytes),
            points: statistics.points as u32,
            bounds: statistics.bounds(),
        };
        self.blocks.push(entry.code, entry.to_bytes())
    }

    /// Notes a node, with what is known of all points in it and below.
    pub(crate) fn node(&mut self, code: Code, statistics: &Statistics) -> Result<()> {
        self.deepest = self.deepest.max(code.level());
        let mut bytes = code.bits().to_le_bytes().to_vec();
        statistics.write(&mut bytes);
        self.nodes.push(code.bits(), bytes)
    }

    /// Writes what stands behind the blocks and puts the file in its place.
    pub(crate) fn finish(self, summary: &Summary, metadata: &Metadata) -> Result<()> {
        let PointWriter { mut out, path, header, mut position, blocks, nodes, .. } = self;
        let (summary, metadata) = (summary.to_bytes(&path)?, metadata.to_bytes(&path)?);
        let mut sections = Vec::new();
        for (tag, list) in [(BLOCKS, blocks), (NODES, nodes)] {
            let mut section = SectionWriter::new(&mut out, position);
            list.finish(&mut |entry| section.write_all(entry).map_err(Error::io(&path, "write a list")))?;
            position += section.written.length;
            sections.push((tag, section.written));
        }
        for (tag, bytes) in [(SUMMARY, summary), (METADATA, metadata)] {
            let mut section = SectionWriter::new(&mut out, position);
            section.write_all(&bytes).map_err(Error::io(&path, "write a section"))?;
            position += section.written.length;
            let written: Section = section.written;
            sections.push((tag, written));
        }
        debug_assert!(position > HEADER_SIZE as u64);
        let trailer = Trailer { header, sections };
        out.write_all(&trailer.to_bytes(position)).map_err(Error::io(&path, "write the trailer"))?;
        out.commit()
    }
}

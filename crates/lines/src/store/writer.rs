//! Writer of files with trees of lines: header, blocks in the order of writing, lists of blocks and
//! nodes, metadata, trailer.

use super::summary::Summary;
use crate::grid::LineGrid;
use crate::statistics::Statistics;
use spinney_base::Result;
use spinney_base::io::{Output, Sorter, directory_of};
use spinney_base::space::Code;
use spinney_container::{BlockEntry, BlockWriter, Content, FileHeader, Metadata, TreeFormat};

/// Tag of the list of blocks of segments.
pub(crate) const BLOCKS: [u8; 4] = *b"LBLK";
/// Tag of the list of nodes.
pub(crate) const NODES: [u8; 4] = *b"LNOD";
/// Tag of the list of blocks of features.
pub(crate) const FEATURES: [u8; 4] = *b"LFEA";
/// Tag of the section that describes the lines.
pub(crate) const SUMMARY: [u8; 4] = *b"LINS";

/// Entry of a list of blocks. The key is the node's code for segments, the first feature's number
/// for features.
pub(crate) type Entry = BlockEntry<3>;

/// Bytes of an entry of the list of nodes.
pub(crate) const NODE_ENTRY: usize = 56;

/// Append-only output file.
pub(crate) struct LineWriter {
    file: BlockWriter,
    blocks: Sorter,
    nodes: Sorter,
    features: Sorter,
}

impl LineWriter {
    /// Starts a file. Each list of entries uses about `memory` bytes before it goes to a temporary
    /// file.
    pub(crate) fn new(out: Output, grid: &LineGrid, memory: u64) -> Result<LineWriter> {
        let (format, content, dimension) = (TreeFormat::Goblin, Content::Lines, grid.dimension);
        let header = FileHeader { format, content, dimension, depth: grid.deepest(), layers: 0 };
        let file = BlockWriter::new(out, header, "lines")?;
        let list = || Sorter::new(directory_of(file.path()), memory);
        let (blocks, nodes, features) = (list(), list(), list());
        Ok(LineWriter { file, blocks, nodes, features })
    }

    /// Writes a block of a node's segments. Blocks of one node must come in order.
    pub(crate) fn block(&mut self, code: Code, bytes: &[u8], statistics: &Statistics) -> Result<()> {
        let block = self.file.block(code.bits(), bytes, statistics.segments as u32)?;
        self.blocks.push(block.key, &Entry { block, bounds: statistics.bounds }.to_bytes())
    }

    /// Writes a block of features; `first` is the first one's number.
    pub(crate) fn features(&mut self, first: u64, bytes: &[u8], count: usize) -> Result<()> {
        let block = self.file.block(first, bytes, count as u32)?;
        self.features.push(first, &Entry { block, bounds: [[0; 3]; 2] }.to_bytes())
    }

    /// Adds a node with the statistics of its subtree.
    pub(crate) fn node(&mut self, code: Code, statistics: &Statistics) -> Result<()> {
        let mut bytes = Vec::with_capacity(NODE_ENTRY);
        for number in [code.bits(), statistics.segments, statistics.features(code.level())] {
            bytes.extend_from_slice(&number.to_le_bytes());
        }
        bytes.extend_from_slice(&statistics.length.to_le_bytes());
        statistics.bounds.iter().flatten().for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
        self.nodes.push(code.bits(), &bytes)
    }

    /// Writes the lists and sections, and commits the file.
    pub(crate) fn finish(self, summary: &Summary, metadata: &Metadata) -> Result<()> {
        let LineWriter { file, blocks, nodes, features } = self;
        let summary = summary.to_bytes(file.path())?;
        file.finish(
            vec![(BLOCKS, blocks), (NODES, nodes), (FEATURES, features)],
            (SUMMARY, summary),
            metadata,
        )
    }
}

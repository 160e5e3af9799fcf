//! Writer of point tree files: header, blocks in order of arrival, lists of blocks and nodes,
//! metadata, trailer.

use std::path::Path;

use super::summary::Summary;
use crate::build::NodeSink;
use crate::grid::PointGrid;
use crate::statistics::Statistics;
use spinney_base::io::{Output, Sorter, directory_of};
use spinney_base::space::Code;
use spinney_base::{Error, Result};
use spinney_container::{BlockEntry, BlockWriter, Content, FileHeader, Metadata, TreeFormat};

/// Tag of the block list.
pub(crate) const BLOCKS: [u8; 4] = *b"PBLK";
/// Tag of the node list.
pub(crate) const NODES: [u8; 4] = *b"PNOD";
/// Tag of the section that describes the points.
pub(crate) const SUMMARY: [u8; 4] = *b"PNTS";

/// Entry of the block list.
pub(crate) type Entry = BlockEntry<3>;

/// File being written, append-only.
pub(crate) struct PointWriter {
    file: BlockWriter,
    blocks: Sorter,
    nodes: Sorter,
}

impl PointWriter {
    /// Starts a file of points. About `memory` bytes hold the entries of each
    /// list before they go to a temporary file.
    pub(crate) fn new(out: Output, grid: &PointGrid, memory: u64) -> Result<PointWriter> {
        let (format, content) = (TreeFormat::Goblin, Content::Points);
        let header =
            FileHeader { format, content, dimension: grid.dimension, depth: grid.deepest(), layers: 0 };
        let file = BlockWriter::new(out, header, "points")?;
        let list = || Sorter::new(directory_of(file.path()), memory);
        let (blocks, nodes) = (list(), list());
        Ok(PointWriter { file, blocks, nodes })
    }

    /// Copies a block of another file; the entry has its offset there.
    ///
    /// # Errors
    /// If its bytes do not match the entry's checksum, or cannot be written.
    pub(crate) fn copy(&mut self, bytes: &[u8], entry: &Entry, from: &Path) -> Result<()> {
        let block = self.file.block(entry.block.key, bytes, entry.block.count)?;
        if block.checksum != entry.block.checksum {
            let (found, expected) = (block.checksum, entry.block.checksum);
            let place = format!("block at byte {}", entry.block.offset);
            return Err(Error::corrupt(
                from,
                place,
                format!("checksum {found:08x}"),
                format!("{expected:08x}"),
            ));
        }
        self.blocks.push(block.key, &Entry { block, bounds: entry.bounds }.to_bytes())
    }

    /// Writes everything after the blocks, and publishes the file.
    pub(crate) fn finish(self, summary: &Summary, metadata: &Metadata) -> Result<()> {
        let summary = summary.to_bytes(self.file.path())?;
        self.file.finish(vec![(BLOCKS, self.blocks), (NODES, self.nodes)], (SUMMARY, summary), metadata)
    }
}

impl NodeSink for PointWriter {
    fn block(&mut self, code: Code, bytes: &[u8], statistics: &Statistics) -> Result<()> {
        let block = self.file.block(code.bits(), bytes, statistics.points as u32)?;
        self.blocks.push(block.key, &Entry { block, bounds: statistics.bounds() }.to_bytes())
    }

    fn node(&mut self, code: Code, statistics: &Statistics) -> Result<()> {
        self.nodes.push(code.bits(), &node_entry(code, statistics))
    }
}

/// Returns the list entry of a node.
pub(crate) fn node_entry(code: Code, statistics: &Statistics) -> Vec<u8> {
    let mut bytes = code.bits().to_le_bytes().to_vec();
    statistics.write(&mut bytes);
    bytes
}

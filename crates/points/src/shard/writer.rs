//! Writes a shard: blocks to its run file, and all else to its light file.

use std::io::Write;
use std::path::PathBuf;

use super::PointShard;
use super::light::{BLOCKS, LIGHT, LightSummary, NODES, ROWS, RowEntry, UNITS, Unit};
use super::light_rows::{LightRows, MAX_ROWS};
use crate::build::{Assembled, Closed, Encoder, PieceSink};
use crate::statistics::{Statistics, statistics_bytes};
use crate::store::{Entry, node_entry};
use spinney_base::io::{FileAccess, Output, Sorter};
use spinney_base::space::Code;
use spinney_base::{Error, Result};
use spinney_container::{BlockLocation, BlockWriter, Content, FileHeader, Metadata, TreeFormat};

/// A shard being written. It is made when [`ShardWriter::finish`] returns; until then nobody takes what is there for it.
pub(super) struct ShardWriter<'a> {
    encoder: &'a Encoder,
    rows: LightRows<'a>,
    run_path: PathBuf,
    access: FileAccess,
    /// The run file, as soon as there is a block.
    run: Option<Output>,
    light: BlockWriter,
    /// Totals that the light file tells.
    summary: LightSummary,
    /// Blocks and nodes of the unit that comes next.
    unit: Unit,
    units: Sorter,
    blocks: Sorter,
    nodes: Sorter,
    row_blocks: Sorter,
}

impl<'a> ShardWriter<'a> {
    /// Starts a shard; about `memory` bytes hold each list before it goes to a temporary file.
    pub(super) fn new(shard: &PointShard, encoder: &'a Encoder, memory: u64) -> Result<ShardWriter<'a>> {
        let grid = &encoder.grid;
        let (format, content) = (TreeFormat::Goblin, Content::Points);
        let header =
            FileHeader { format, content, dimension: grid.dimension, depth: grid.deepest(), layers: 0 };
        let list = |entry| Sorter::new(&shard.folder, entry, memory);
        Ok(ShardWriter {
            encoder,
            rows: LightRows::new(encoder),
            run_path: shard.run_path(),
            access: shard.access.clone(),
            run: None,
            light: BlockWriter::new(shard.access.create(&shard.light_path())?, header, "shards")?,
            summary: LightSummary::new(shard),
            unit: Unit::default(),
            units: list(Unit::BYTES),
            blocks: list(Entry::BYTES),
            nodes: list(8 + statistics_bytes(encoder.block.columns)),
            row_blocks: list(RowEntry::BYTES),
        })
    }

    /// Ends a unit whose blocks and nodes have been written.
    pub(super) fn end_unit(&mut self, code: Code, assembled: Assembled) -> Result<()> {
        let Assembled { closed, mut levels, mut above } = assembled;
        let stride = self.encoder.stride();
        match closed {
            Closed::Node(statistics) => self.summary.points += statistics.points,
            Closed::Few(pending) => {
                // (Their node is not known yet: their own level tells them from those above.)
                levels.resize(levels.len() + pending.rows.len() / stride, code.level());
                above.extend_from_slice(&pending.rows);
            }
        }
        self.summary.points += levels.len() as u64;
        for (rows, levels) in above.chunks(MAX_ROWS * stride).zip(levels.chunks(MAX_ROWS)) {
            let bytes = self.rows.encode(rows, levels);
            let block = self.light.block(code.bits(), &bytes, levels.len() as u32)?;
            self.row_blocks.push(block.offset, RowEntry { block, bounds: [[]; 2] }.to_bytes())?;
            self.unit.rows += 1;
        }
        let unit = std::mem::take(&mut self.unit);
        self.units.push(code.bits(), Unit { code: code.bits(), ..unit }.to_bytes())
    }

    /// Puts both files in their places; so many of the points are at the place of another one.
    pub(super) fn finish(mut self, duplicates: u64) -> Result<()> {
        self.summary.duplicates = duplicates;
        self.run.map_or(Ok(()), Output::commit)?;
        let lists =
            vec![(UNITS, self.units), (BLOCKS, self.blocks), (NODES, self.nodes), (ROWS, self.row_blocks)];
        let summary = self.summary.to_bytes(self.light.path())?;
        self.light.finish(lists, (LIGHT, summary), &Metadata::default())
    }
}

impl PieceSink for ShardWriter<'_> {
    fn block(&mut self, code: Code, bytes: &[u8], statistics: &Statistics) -> Result<()> {
        let run = match &mut self.run {
            Some(run) => run,
            none => none.insert(self.access.create(&self.run_path)?),
        };
        run.write_all(bytes).map_err(Error::io(&self.run_path, "write a block"))?;
        let block = BlockLocation {
            key: code.bits(),
            offset: self.summary.run_bytes,
            length: bytes.len() as u32,
            checksum: crc32c::crc32c(bytes),
            count: statistics.points as u32,
        };
        self.summary.run_bytes += bytes.len() as u64;
        self.unit.blocks += 1;
        self.blocks.push(block.offset, Entry { block, bounds: statistics.bounds() }.to_bytes())
    }

    fn node(&mut self, code: Code, statistics: &Statistics) -> Result<()> {
        self.unit.nodes += 1;
        self.nodes.push(self.nodes.len(), node_entry(code, statistics))
    }
}

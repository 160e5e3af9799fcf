//! Writes a shard: blocks to its run file, everything else to its summary.

use std::io::Write;
use std::path::PathBuf;

use super::PointShard;
use super::packed_rows::{MAX_ROWS, PackedRows};
use super::units::{BLOCK, END, NODE, PointTotals, ROWS, UNIT};
use crate::build::{Assembled, Closed, Encoder, NodeSink};
use crate::statistics::Statistics;
use crate::store::{Entry, node_entry};
use spinney_base::io::Output;
use spinney_base::space::Code;
use spinney_base::{Error, Result};
use spinney_container::{BlockLocation, SummaryWriter};

/// A shard being written. No reader uses its files before [`ShardWriter::finish`] returns.
pub(super) struct ShardWriter<'a> {
    encoder: &'a Encoder,
    rows: PackedRows<'a>,
    run_path: PathBuf,
    /// The run file, once there is a block, and its size in bytes.
    run: Option<Output>,
    run_bytes: u64,
    summary: SummaryWriter<PointTotals>,
    /// Whether the shard has units.
    has_units: bool,
    totals: PointTotals,
    /// The current unit.
    unit: Code,
}

impl<'a> ShardWriter<'a> {
    /// Starts a shard.
    pub(super) fn new(shard: &PointShard, encoder: &'a Encoder) -> Result<ShardWriter<'a>> {
        let mut summary = SummaryWriter::new(&shard.shard)?;
        shard.shard.ranges.first().into_iter().for_each(|range| summary.begin(*range));
        Ok(ShardWriter {
            encoder,
            rows: PackedRows::new(encoder),
            run_path: shard.shard.run_path(0),
            run: None,
            run_bytes: 0,
            summary,
            has_units: shard.run().is_some(),
            totals: PointTotals { level: shard.level, points: 0, duplicates: 0 },
            unit: Code::root(encoder.grid.dimension),
        })
    }

    /// Starts a unit, whose blocks and nodes follow.
    pub(super) fn begin_unit(&mut self, code: Code) -> Result<()> {
        self.unit = code;
        self.item(UNIT, &code.bits().to_le_bytes())
    }

    fn item(&mut self, tag: u8, bytes: &[u8]) -> Result<()> {
        self.summary.write(&[tag])?;
        self.summary.write(bytes)
    }

    /// Ends a unit whose blocks and nodes have been written.
    pub(super) fn end_unit(&mut self, assembled: Assembled) -> Result<()> {
        let Assembled { closed, mut levels, mut above } = assembled;
        let stride = self.encoder.stride();
        match closed {
            Closed::Node(statistics) => self.totals.points += statistics.points,
            Closed::Few(pending) => {
                // Rows that are not assigned to a node yet get the unit's level, which
                // distinguishes them from those of nodes above.
                levels.resize(levels.len() + pending.rows.len() / stride, self.unit.level());
                above.extend_from_slice(&pending.rows);
            }
        }
        self.totals.points += levels.len() as u64;
        for (rows, levels) in above.chunks(MAX_ROWS * stride).zip(levels.chunks(MAX_ROWS)) {
            let bytes = self.rows.encode(rows, levels);
            let [count, length] = [levels.len(), bytes.len()].map(|number| (number as u64).to_le_bytes());
            self.item(ROWS, &[count, length].concat())?;
            self.summary.write(&bytes)?;
        }
        self.item(END, &[])
    }

    /// Publishes both files; `duplicates` is the number of points that repeat a position.
    pub(super) fn finish(mut self, duplicates: u64) -> Result<()> {
        self.run.map_or(Ok(()), Output::commit)?;
        if self.has_units {
            self.summary.end(self.run_bytes, PointTotals { duplicates, ..self.totals })?;
        }
        self.summary.finish()
    }
}

impl NodeSink for ShardWriter<'_> {
    fn block(&mut self, code: Code, bytes: &[u8], statistics: &Statistics) -> Result<()> {
        let run = match &mut self.run {
            Some(run) => run,
            none => none.insert(self.summary.access().create(&self.run_path)?),
        };
        run.write_all(bytes).map_err(Error::io(&self.run_path, "write a block"))?;
        let block = BlockLocation {
            key: code.bits(),
            offset: self.run_bytes,
            length: bytes.len() as u32,
            checksum: crc32c::crc32c(bytes),
            count: statistics.points as u32,
        };
        self.run_bytes += bytes.len() as u64;
        self.item(BLOCK, &Entry { block, bounds: statistics.bounds() }.to_bytes())
    }

    fn node(&mut self, code: Code, statistics: &Statistics) -> Result<()> {
        self.item(NODE, &node_entry(code, statistics))
    }
}

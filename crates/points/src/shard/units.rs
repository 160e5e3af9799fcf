//! Units of a shard as stored in its summary.
//!
//! A unit is a sequence of tagged items: its code; its blocks and nodes, both in postorder; its
//! rows; and an end.
//!
//! Invariant: the reader accepts exactly what the writer of a correct shard can write. Units ascend
//! and lie in the shard's run, blocks are consecutive in the run file, and points and bytes add up
//! to the totals. Merging can thus copy blocks without reading their points.

use super::packed_rows::{MAX_ROWS, PackedRows};
use super::{PointShard, postorder};
use crate::build::{Assembled, Closed, Encoder, MAX_NUMBERS, Pending};
use crate::codec::MAX_POINTS;
use crate::grid::spacing_levels;
use crate::statistics::{Statistics, statistics_bytes};
use crate::store::Entry;
use serde::{Deserialize, Serialize};
use spinney_base::space::Code;
use spinney_base::{Error, Result};
use spinney_container::{ShardSummary, SummaryBytes};

/// Item tags.
pub(super) const UNIT: u8 = 1;
pub(super) const BLOCK: u8 = 2;
pub(super) const NODE: u8 = 3;
pub(super) const ROWS: u8 = 4;
pub(super) const END: u8 = 5;

/// Totals of a shard.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct PointTotals {
    /// Level of the units.
    pub level: u8,
    /// Number of points, and of those that repeat the position of another one.
    pub points: u64,
    pub duplicates: u64,
}

/// Returns the size in bytes of a shard's blocks; `None` if it is not built yet or its run file is
/// missing.
///
/// # Errors
/// If its summary cannot be read, is corrupt, or belongs to another job.
pub fn find_shard(shard: &PointShard) -> Result<Option<u64>> {
    Ok(find_summary(shard)?.map(|summary| summary.run_bytes()))
}

/// Opens a shard's summary, and checks its totals: see [`ShardSummary::find`].
pub(super) fn find_summary(shard: &PointShard) -> Result<Option<ShardSummary<PointTotals>>> {
    let Some(summary) = ShardSummary::<PointTotals>::find(&shard.shard)? else { return Ok(None) };
    for range in &summary.ranges {
        let PointTotals { level, points, duplicates } = range.totals;
        if level != shard.level {
            return Err(shard.shard.another_job());
        }
        if points > MAX_NUMBERS || duplicates > points {
            let found = format!("{points} points, {duplicates} duplicates");
            let expected = format!("at most {MAX_NUMBERS}, and no more duplicates");
            return Err(Error::corrupt(summary.path(), "totals", found, expected));
        }
    }
    Ok(Some(summary))
}

/// A unit that has points.
pub(super) struct Unit {
    pub(super) code: Code,
    /// Result of assembling the unit, and rows of nodes above it.
    pub(super) assembled: Assembled,
    /// Its blocks, with offsets in the run file, and its nodes, both in postorder.
    pub(super) blocks: Vec<Entry>,
    pub(super) nodes: Vec<(Code, Statistics)>,
    /// Number of all points.
    pub(super) points: u64,
}

/// Reads and checks the units of a shard in sequence.
pub(super) struct Units<'a> {
    summary: ShardSummary<PointTotals>,
    bytes: Option<SummaryBytes>,
    encoder: &'a Encoder,
    codec: PackedRows<'a>,
    /// Maximum number of points in a leaf.
    leaf_size: usize,
    shard: &'a PointShard,
    /// Units, bytes of blocks and points read so far, and the last unit.
    count: usize,
    run_bytes: u64,
    points: u64,
    last: Option<Code>,
}

impl<'a> Units<'a> {
    /// Starts at the first unit of a shard; `leaf_size` is that of the tree.
    ///
    /// # Errors
    /// If the summary is corrupt or cannot be read.
    pub(super) fn new(
        summary: ShardSummary<PointTotals>,
        shard: &'a PointShard,
        encoder: &'a Encoder,
        leaf_size: usize,
    ) -> Result<Units<'a>> {
        let bytes = summary.ranges.first().map(|range| summary.bytes_of(range)).transpose()?;
        let (codec, count, run_bytes, points, last) = (PackedRows::new(encoder), 0, 0, 0, None);
        Ok(Units { summary, bytes, encoder, codec, leaf_size, shard, count, run_bytes, points, last })
    }

    /// Returns the totals of the shard.
    pub(super) fn totals(&self) -> PointTotals {
        self.summary.ranges.first().map(|range| range.totals).unwrap_or_default()
    }

    /// Returns the error for an invalid unit.
    pub(super) fn corrupt(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        Error::corrupt(self.summary.path(), format!("unit {}", self.count), found, expected)
    }

    /// Returns the next unit; `None` after the last.
    ///
    /// # Errors
    /// If the summary is corrupt or cannot be read.
    pub(super) fn next(&mut self) -> Result<Option<Unit>> {
        let Some(mut bytes) = self.bytes.take() else { return Ok(None) };
        if bytes.is_over() {
            let (PointTotals { points, .. }, run_bytes) = (self.totals(), self.summary.run_bytes());
            return match (run_bytes, points) == (self.run_bytes, self.points) {
                true => Ok(None),
                false => {
                    let found = format!("{} points in {} bytes", self.points, self.run_bytes);
                    Err(self.corrupt(found, format!("{points} in {run_bytes} bytes of blocks")))
                }
            };
        }
        let unit = self.unit(&mut bytes)?;
        self.bytes = Some(bytes);
        self.points = self.points.saturating_add(unit.points);
        self.count += 1;
        self.last = Some(unit.code);
        Ok(Some(unit))
    }

    fn unit(&mut self, bytes: &mut SummaryBytes) -> Result<Unit> {
        let [tag] = bytes.array()?;
        let bits = u64::from_le_bytes(bytes.array()?);
        let code = Code::from_bits(self.encoder.grid.dimension, bits).filter(|code| {
            tag == UNIT
                && code.level() == self.shard.level
                && self.shard.run().is_some_and(|run| run.contains(*code))
                && self.last.is_none_or(|last| last < *code)
        });
        let Some(code) = code else {
            return Err(self.corrupt(format!("code {bits:x}"), "units of the shard in ascending order"));
        };
        let (mut blocks, mut nodes) = (Vec::new(), Vec::new());
        let (mut rows, mut levels) = (Vec::new(), Vec::new());
        loop {
            match bytes.array()? {
                [BLOCK] => blocks.push(self.block(code, blocks.last(), bytes)?),
                [NODE] => nodes.push(self.node(code, nodes.last(), bytes)?),
                [ROWS] => self.rows(bytes, &mut rows, &mut levels)?,
                [END] => break,
                [tag] => return Err(self.corrupt(format!("an item with tag {tag}"), "tags 1 to 5")),
            }
        }
        let grid = &self.encoder.grid;
        let mut all = rows.chunks_exact(self.encoder.stride()).map(crate::attribute::position_of);
        if !all.all(|position| grid.code(position).is_some_and(|point| code.contains(point))) {
            return Err(self.corrupt("a row outside its unit", "rows inside the unit"));
        }
        let handed_up = levels.len() as u64;
        let assembled = self.assembled(code, (&blocks, &nodes), rows, levels)?;
        let points = blocks.iter().map(|entry| u64::from(entry.block.count)).sum::<u64>() + handed_up;
        Ok(Unit { code, assembled, blocks, nodes, points })
    }

    /// Returns the result of assembling a unit, and the rows of nodes above it.
    fn assembled(
        &self,
        code: Code,
        (blocks, nodes): (&[Entry], &[(Code, Statistics)]),
        mut rows: Vec<u8>,
        mut levels: Vec<u8>,
    ) -> Result<Assembled> {
        let own = levels.iter().position(|level| *level >= code.level()).unwrap_or(levels.len());
        let few = rows.split_off(own * self.encoder.stride());
        let few_levels = levels.split_off(own);
        let in_blocks: u64 = blocks.iter().map(|entry| u64::from(entry.block.count)).sum();
        let closed = match nodes.last() {
            Some((last, statistics)) if *last == code && statistics.points == in_blocks && few.is_empty() => {
                Closed::Node(statistics.clone())
            }
            None if blocks.is_empty() && few_levels.iter().all(|level| *level == code.level()) => {
                Closed::Few(Pending { code, rows: few })
            }
            _ => {
                let found = format!(
                    "{} nodes, {in_blocks} points in blocks, {} points",
                    nodes.len(),
                    few_levels.len()
                );
                return Err(self.corrupt(found, "one node with all points in blocks, or only points"));
            }
        };
        Ok(Assembled { closed, levels, above: rows })
    }

    /// Returns the node of a unit with this code; `None` if the code is invalid or outside the
    /// unit.
    fn node_of(&self, unit: Code, bits: u64) -> Option<Code> {
        let grid = &self.encoder.grid;
        let code = Code::from_bits(grid.dimension, bits);
        code.filter(|code| unit.contains(*code) && code.level() <= grid.deepest())
    }

    fn block(&mut self, unit: Code, before: Option<&Entry>, bytes: &mut SummaryBytes) -> Result<Entry> {
        let entry = Entry::from_bytes(&bytes.take(Entry::BYTES as u64)?);
        let order = |entry: &Entry| self.node_of(unit, entry.block.key).map(postorder);
        let follows = order(&entry).is_some() && before.and_then(order) <= order(&entry);
        let fits =
            (1..=MAX_POINTS as u32).contains(&entry.block.count) && entry.block.offset == self.run_bytes;
        if !follows || !fits {
            return Err(self.corrupt(format!("{entry:?}"), "consecutive blocks of nodes in postorder"));
        }
        // Saturation is harmless: files have fewer than 2^64 bytes, so the first missing block is
        // reported before it matters.
        self.run_bytes = self.run_bytes.saturating_add(entry.block.length.into());
        Ok(entry)
    }

    fn node(
        &self,
        unit: Code,
        before: Option<&(Code, Statistics)>,
        bytes: &mut SummaryBytes,
    ) -> Result<(Code, Statistics)> {
        let code = self.node_of(unit, u64::from_le_bytes(bytes.array()?));
        let before = before.map(|(code, _)| postorder(*code));
        let Some(code) = code.filter(|code| before < Some(postorder(*code))) else {
            return Err(
                self.corrupt("a node out of order or outside its unit", "nodes of the unit in postorder")
            );
        };
        let statistics = Statistics::read(&bytes.take(statistics_bytes(self.encoder.block.columns) as u64)?);
        // Keeps sums from overflowing.
        let numbers = statistics.columns.iter().map(|column| column.count).max().unwrap_or(0);
        if statistics.points > MAX_NUMBERS || numbers > statistics.points {
            let found = format!("{} points, {numbers} values in a column", statistics.points);
            return Err(self.corrupt(found, format!("at most {MAX_NUMBERS} points, and no more values")));
        }
        Ok((code, statistics))
    }

    /// Appends rows of a unit and their levels. Rows of nodes above come first.
    fn rows(&self, bytes: &mut SummaryBytes, rows: &mut Vec<u8>, levels: &mut Vec<u8>) -> Result<()> {
        let [count, length] = [bytes.array()?, bytes.array()?].map(u64::from_le_bytes);
        let max = self.max_rows().saturating_sub(levels.len() as u64).min(MAX_ROWS as u64);
        if !(1..=max).contains(&count) {
            return Err(self.corrupt(format!("{count} rows"), format!("1 to {max}")));
        }
        let decoded = self.codec.decode(&bytes.take(length)?, count as usize, rows, levels);
        decoded.ok_or_else(|| self.corrupt("bytes that do not decode", "compressed rows"))
    }

    /// Maximum number of rows of a unit: one per sampling cell of each node above, plus those of a
    /// leaf.
    fn max_rows(&self) -> u64 {
        let dimension = self.encoder.grid.dimension;
        let spacing = spacing_levels(dimension);
        let sampling_cells =
            |level: u8| 1u64 << (dimension.axes() * usize::from(level + spacing - self.shard.level));
        (0..self.shard.level).map(sampling_cells).sum::<u64>() + self.leaf_size as u64
    }
}

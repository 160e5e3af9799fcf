//! Light files: all of a shard but its blocks' bytes.
//!
//! They are files of blocks as trees of points are, with other sections. They are read by other processes than those that have written them, perhaps much later:
//! nothing in them is believed.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::light_rows::{LightRows, MAX_ROWS};
use super::{PointShard, postorder};
use crate::build::{Assembled, Closed, Encoder, MAX_NUMBERS, Pending};
use crate::codec::MAX_POINTS;
use crate::grid::spacing_levels;
use crate::statistics::{Statistics, statistics_bytes};
use crate::store::Entry;
use spinney_base::space::Code;
use spinney_base::{Error, Result};
use spinney_container::{BlockEntry, BlockFile, Content, List, OpenOptions, VersionedSection};

/// Tag of the section that says which shard this is.
pub(super) const LIGHT: [u8; 4] = *b"SHRD";
/// Tags of the lists: units by their codes; blocks and nodes in postorder; and blocks of rows, as units have them.
pub(super) const UNITS: [u8; 4] = *b"SUNI";
pub(super) const BLOCKS: [u8; 4] = *b"SBLK";
pub(super) const NODES: [u8; 4] = *b"SNOD";
pub(super) const ROWS: [u8; 4] = *b"SROW";

/// The section, whose version is that of all that is in the file.
const SECTION: VersionedSection<1024> = VersionedSection { name: "shard", version: 1 };

/// An entry of the list of blocks of rows.
pub(super) type RowEntry = BlockEntry<0>;

/// A unit that has points: how much of each list it has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Unit {
    pub code: u64,
    pub blocks: u32,
    pub nodes: u32,
    pub rows: u32,
}

impl Unit {
    /// Bytes of an entry.
    pub(super) const BYTES: usize = 20;

    pub(super) fn to_bytes(self) -> Vec<u8> {
        let mut bytes = self.code.to_le_bytes().to_vec();
        [self.blocks, self.nodes, self.rows]
            .iter()
            .for_each(|count| bytes.extend_from_slice(&count.to_le_bytes()));
        bytes
    }

    fn from_bytes(bytes: &[u8]) -> Option<Unit> {
        let (code, rest) = bytes.split_first_chunk()?;
        let [blocks, nodes, rows] = *rest.as_chunks::<4>().0 else { return None };
        let [blocks, nodes, rows] = [blocks, nodes, rows].map(u32::from_le_bytes);
        Some(Unit { code: u64::from_le_bytes(*code), blocks, nodes, rows })
    }
}

/// Which shard this is, and what it has in all.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct LightSummary {
    job: u128,
    number: u32,
    level: u8,
    run: Option<[u64; 2]>,
    /// Bytes of the run file.
    pub run_bytes: u64,
    /// Points, and those at the place of another one.
    pub points: u64,
    pub duplicates: u64,
}

impl LightSummary {
    /// That of a shard of which nothing is there yet.
    pub(super) fn new(shard: &PointShard) -> LightSummary {
        let PointShard { job, number, level, run, .. } = *shard;
        let run = run.map(|run| run.ends());
        LightSummary { job, number, level, run, run_bytes: 0, points: 0, duplicates: 0 }
    }

    pub(super) fn to_bytes(&self, path: &Path) -> Result<Vec<u8>> {
        SECTION.encode(self).ok_or_else(|| Error::corrupt(path, "shard", "many bytes", "numbers"))
    }

    fn from_bytes(path: &Path, bytes: &[u8]) -> Result<LightSummary> {
        let (summary, used): (LightSummary, usize) = SECTION.decode(path, bytes)?;
        match used == bytes.len() && summary.points <= MAX_NUMBERS && summary.duplicates <= summary.points {
            true => Ok(summary),
            false => {
                let found = format!("{summary:?} in {} bytes", bytes.len());
                Err(Error::corrupt(path, "shard", found, "what is known of a shard"))
            }
        }
    }
}

/// Bytes of the blocks of a shard; `None` if it is not made yet, or not all of it is there.
///
/// # Errors
/// If its light file cannot be read or is damaged, or if it is that of another job.
pub fn find_shard(shard: &PointShard) -> Result<Option<u64>> {
    Ok(LightFile::find(shard)?.map(|light| light.summary.run_bytes))
}

/// A light file that is open.
pub(super) struct LightFile {
    pub(super) file: BlockFile,
    pub(super) summary: LightSummary,
}

impl LightFile {
    /// Opens that of a shard, and makes sure that it is of this one, and that the run file has its length; `None` if the shard is not made yet, or
    /// not all of it is there.
    ///
    /// # Errors
    /// If it cannot be read or is damaged, or if it is that of another job.
    pub(super) fn find(shard: &PointShard) -> Result<Option<LightFile>> {
        let path = shard.light_path();
        if length_of(&path)?.is_none() {
            return Ok(None);
        }
        let options: OpenOptions = (&shard.access).into();
        let file = BlockFile::open(&path, options.open(&path)?, (Content::Points, "a light file"), &options)?;
        let summary = LightSummary::from_bytes(&path, &file.section(LIGHT, "shard")?)?;
        let LightSummary { run_bytes, points, duplicates, .. } = summary;
        if summary != (LightSummary { run_bytes, points, duplicates, ..LightSummary::new(shard) }) {
            let advice = format!("remove the folder {}, and build its shards again", shard.folder.display());
            return Err(Error::unsupported(&path, "a shard of another job", advice));
        }
        let is_there = run_bytes == 0 || length_of(&shard.run_path())? == Some(run_bytes);
        Ok(is_there.then_some(LightFile { file, summary }))
    }
}

/// Bytes of a file; nothing if there is none.
fn length_of(path: &Path) -> Result<Option<u64>> {
    match std::fs::metadata(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        found => Ok(Some(found.map_err(Error::io(path, "look at"))?.len())),
    }
}

/// Entry of a light file for a unit.
pub(super) struct LightUnit {
    pub(super) code: Code,
    /// Its outcome, and rows of nodes above.
    pub(super) assembled: Assembled,
    /// Its blocks, whose offsets are those in the run file, and its nodes, both in postorder.
    pub(super) blocks: Vec<Entry>,
    pub(super) nodes: Vec<(Code, Statistics)>,
    /// All points.
    pub(super) points: u64,
}

/// The units of a light file, one after the other.
pub(super) struct LightUnits<'a> {
    light: &'a LightFile,
    encoder: &'a Encoder,
    codec: LightRows<'a>,
    /// Points of a leaf.
    leaf_size: usize,
    shard: &'a PointShard,
    lists: [List; 4],
    /// Entries of lists that were taken, bytes of blocks, and points.
    taken: [usize; 4],
    run_bytes: u64,
    points: u64,
    last: Option<Code>,
}

impl<'a> LightUnits<'a> {
    /// Those of a shard of a tree with leaves of so many points.
    ///
    /// # Errors
    /// If a list is damaged.
    pub(super) fn new(
        light: &'a LightFile,
        shard: &'a PointShard,
        encoder: &'a Encoder,
        leaf_size: usize,
    ) -> Result<LightUnits<'a>> {
        let file = &light.file;
        let units = file.list(UNITS, "list of units", Unit::BYTES)?;
        let blocks = file.list(BLOCKS, "list of blocks", Entry::BYTES)?;
        let nodes = file.list(NODES, "list of nodes", 8 + statistics_bytes(encoder.block.columns))?;
        let rows = file.list(ROWS, "list of rows", RowEntry::BYTES)?;
        file.check_blocks(&[("rows", &rows, MAX_ROWS)], file.end(UNITS))?;
        let (lists, codec) = ([units, blocks, nodes, rows], LightRows::new(encoder));
        Ok(LightUnits {
            light,
            encoder,
            codec,
            leaf_size,
            shard,
            lists,
            taken: [0; 4],
            run_bytes: 0,
            points: 0,
            last: None,
        })
    }

    fn corrupt(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        self.light.file.corrupt(format!("unit {}", self.taken[0]), found, expected)
    }

    /// The next one; `None` behind the last.
    ///
    /// # Errors
    /// If something cannot be read, or is not what somebody wrote.
    pub(super) fn next(&mut self) -> Result<Option<LightUnit>> {
        let [units, ..] = &self.lists;
        if self.taken[0] == units.len() {
            let LightSummary { run_bytes, points, .. } = self.light.summary;
            let are_over = (0..4).all(|list| self.taken[list] == self.lists[list].len());
            return match are_over && (run_bytes, points) == (self.run_bytes, self.points) {
                true => Ok(None),
                false => {
                    let expected = format!("{points} in {run_bytes} bytes of blocks, and no entry more");
                    Err(self.corrupt(format!("{} points in {} bytes", self.points, self.run_bytes), expected))
                }
            };
        }
        let Some(unit) = Unit::from_bytes(self.light.file.entry(units, self.taken[0])) else {
            return Err(self.corrupt("no unit", "a file that nobody cuts short"));
        };
        let code = Code::from_bits(self.encoder.grid.dimension, unit.code);
        let code = code.filter(|code| {
            code.level() == self.shard.level
                && self.shard.run.is_some_and(|run| run.contains(*code))
                && self.last.is_none_or(|last| last < *code)
        });
        let Some(code) = code else {
            return Err(self.corrupt(format!("code {:x}", unit.code), "units of the shard that ascend"));
        };
        let counts = [unit.blocks, unit.nodes, unit.rows].map(|count| count as usize);
        if (1..4).any(|list| counts[list - 1] > self.lists[list].len() - self.taken[list]) {
            return Err(self.corrupt(format!("{counts:?} entries of the lists"), "no more than there are"));
        }
        let blocks = self.blocks(code, counts[0])?;
        let nodes = self.nodes(code, counts[1])?;
        let (rows, levels) = self.rows(code, counts[2])?;
        let assembled = self.assembled(code, (&blocks, &nodes), rows, levels)?;
        let points = blocks.iter().map(|entry| u64::from(entry.block.count)).sum::<u64>();
        let handed_up = match &assembled.closed {
            Closed::Few(pending) => pending.rows.len() / self.encoder.stride(),
            Closed::Node(_) => 0,
        };
        let points = points + (handed_up + assembled.levels.len()) as u64;
        self.points = self.points.saturating_add(points);
        self.taken[0] += 1;
        self.last = Some(code);
        Ok(Some(LightUnit { code, assembled, blocks, nodes, points }))
    }

    /// Outcome of a unit, and the rows of nodes above.
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
                return Err(self.corrupt(found, "a node with its points in blocks, or points alone"));
            }
        };
        Ok(Assembled { closed, levels, above: rows })
    }

    fn blocks(&mut self, unit: Code, count: usize) -> Result<Vec<Entry>> {
        let mut blocks = Vec::new();
        let mut before = None;
        for _ in 0..count {
            let entry = Entry::from_bytes(self.light.file.entry(&self.lists[1], self.taken[1]));
            let code = Code::from_bits(self.encoder.grid.dimension, entry.block.key);
            let code =
                code.filter(|code| unit.contains(*code) && code.level() <= self.encoder.grid.deepest());
            let order = code.map(postorder);
            let fits =
                (1..=MAX_POINTS as u32).contains(&entry.block.count) && entry.block.offset == self.run_bytes;
            if order.is_none() || before > order || !fits {
                return Err(
                    self.corrupt(format!("{entry:?}"), "blocks of nodes in postorder, one behind the other")
                );
            }
            before = order;
            // (Files have fewer than 2^64 bytes: so have all blocks one behind the other, before the first that is not there.)
            self.run_bytes = self.run_bytes.saturating_add(entry.block.length.into());
            self.taken[1] += 1;
            blocks.push(entry);
        }
        Ok(blocks)
    }

    fn nodes(&mut self, unit: Code, count: usize) -> Result<Vec<(Code, Statistics)>> {
        let mut nodes = Vec::new();
        let mut before = None;
        for _ in 0..count {
            let entry = self.light.file.entry(&self.lists[2], self.taken[2]);
            let bits = entry.first_chunk().map(|code| u64::from_le_bytes(*code));
            let code = bits.and_then(|bits| Code::from_bits(self.encoder.grid.dimension, bits));
            let code =
                code.filter(|code| unit.contains(*code) && code.level() <= self.encoder.grid.deepest());
            let order = code.map(postorder);
            let Some(code) = code.filter(|_| before < order) else {
                return Err(self.corrupt("nodes that do not fit", "nodes of the unit in postorder"));
            };
            let statistics = Statistics::read(&entry[8..]);
            // (So that sums stay numbers.)
            let most = statistics.columns.iter().map(|column| column.count).max().unwrap_or(0);
            if statistics.points > MAX_NUMBERS || most > statistics.points {
                let found = format!("{} points, {most} of which are numbers", statistics.points);
                return Err(self.corrupt(found, format!("at most {MAX_NUMBERS}, and as many")));
            }
            before = order;
            self.taken[2] += 1;
            nodes.push((code, statistics));
        }
        Ok(nodes)
    }

    /// The rows of a unit, and their levels: those of nodes above first.
    fn rows(&mut self, unit: Code, count: usize) -> Result<(Vec<u8>, Vec<u8>)> {
        let (mut rows, mut levels) = (Vec::new(), Vec::new());
        let most = self.most_rows();
        let mut sum = 0;
        for _ in 0..count {
            let entry = RowEntry::from_bytes(self.light.file.entry(&self.lists[3], self.taken[3])).block;
            sum += u64::from(entry.count);
            if entry.key != unit.bits() || sum > most {
                let found = format!("{sum} rows of node {:x}", entry.key);
                return Err(self.corrupt(found, format!("at most {most} of the unit")));
            }
            let place = format!("rows {}", self.taken[3]);
            let bytes = self.light.file.block(&place, &entry)?;
            let decoded = self.codec.decode(&bytes, entry.count as usize, &mut rows, &mut levels);
            if decoded.is_none() {
                return Err(self.light.file.corrupt(
                    place,
                    "bytes that no rows have",
                    "rows that were packed",
                ));
            }
            self.taken[3] += 1;
        }
        let grid = &self.encoder.grid;
        let place = crate::attribute::place_of;
        let mut all = rows.chunks_exact(self.encoder.stride());
        match all.all(|row| grid.code(place(row)).is_some_and(|code| unit.contains(code))) {
            true => Ok((rows, levels)),
            false => Err(self.corrupt("a row beside its unit", "points of the unit")),
        }
    }

    /// Rows that a unit has at most: one for each part of the spacing of nodes above, and those of a leaf.
    fn most_rows(&self) -> u64 {
        let dimension = self.encoder.grid.dimension;
        let spacing = spacing_levels(dimension);
        let parts = |level: u8| 1u64 << (dimension.axes() * usize::from(level + spacing - self.shard.level));
        (0..self.shard.level).map(parts).sum::<u64>() + self.leaf_size as u64
    }
}

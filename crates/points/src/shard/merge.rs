//! Puts the shards of a tree together: their blocks one behind the other, and the nodes above them.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use super::units::{PointTotals, Unit, Units, find_summary};
use super::{PointShard, deepest_units};
use crate::build::{Assembler, BuildSummary, Encoder, MAX_NUMBERS, PieceSink, write_pieces, write_root};
use crate::store::{Entry, PointTree, PointWriter, Summary};
use spinney_base::io::{Output, open_input};
use spinney_base::space::{Code, CodeRun};
use spinney_base::{Error, Progress, Result};
use spinney_container::ShardSummary;

/// Puts a tree together whose shards are all made: the bytes are those of a file that was built in one go. `head` tells of the tree. Blocks are
/// checked and copied, and no points are read but those of nodes above; about `memory` bytes hold each list before it goes to a temporary file. `points` is
/// how many there have to be, where that is known. Progress counts bytes.
///
/// # Errors
/// If a shard is missing, damaged or of another job, if shards leave gaps or overlap, if there are not as many points, or if the output cannot be
/// written; on interruption. There is no output then.
pub fn merge_shards(
    head: &Path,
    shards: &[PointShard],
    points: Option<u64>,
    (output, memory): (Output, u64),
    progress: &dyn Progress,
) -> Result<BuildSummary> {
    let access = shards.first().map_or(output.access(), |shard| &shard.shard.access);
    let planned = PointTree::open(head, &access.into())?;
    let encoder = Encoder::new(planned.layout().clone(), planned.grid().clone());
    let leaf_size = planned.summary().leaf_size as usize;
    check_cover(head, shards, &encoder)?;
    let mut total = 0u64;
    for shard in shards {
        total = total.saturating_add(find(shard)?.run_bytes());
    }
    let mut writer = PointWriter::new(output, &encoder.grid, encoder.block.columns, memory)?;
    let top = Code::root(encoder.grid.dimension);
    let mut assembler = Assembler::new(&encoder, leaf_size, top);
    let mut summary = BuildSummary::default();
    for shard in shards {
        let mut run = RunFile::new(shard.shard.run_path(0));
        let mut units = Units::new(find(shard)?, shard, &encoder, leaf_size)?;
        while let Some(unit) = units.next()? {
            progress.check()?;
            summary.points = summary.points.saturating_add(unit.points);
            if summary.points > MAX_NUMBERS {
                let found = format!("{} points and more", summary.points);
                return Err(units.corrupt(found, format!("at most {MAX_NUMBERS} in a file")));
            }
            let Unit { code, assembled, blocks, nodes, .. } = unit;
            assembler.reach(code, &assembled.closed);
            write_pieces(std::mem::take(&mut assembler.pieces), &mut writer)?;
            for entry in &blocks {
                run.read(entry)?;
                writer.copy(&run.bytes, entry, &run.path)?;
                progress.advance(entry.block.length.into(), total);
            }
            for (code, statistics) in &nodes {
                writer.node(*code, statistics)?;
            }
            assembler.join(code, assembled);
            write_pieces(std::mem::take(&mut assembler.pieces), &mut writer)?;
        }
        // (The units have as many points as the totals: so the sum is at most that of points.)
        summary.duplicates += units.totals().duplicates;
    }
    if points.is_some_and(|points| points != summary.points) {
        let expected = format!("{}, as headers of files say", points.unwrap_or_default());
        return Err(Error::corrupt(head, "points of all shards", summary.points.to_string(), expected));
    }
    let (assembled, pieces) = assembler.finish();
    write_pieces(pieces, &mut writer)?;
    write_root(&encoder, assembled.closed, &mut writer)?;
    writer.finish(&Summary::new(&encoder, leaf_size, summary), planned.metadata())?;
    Ok(summary)
}

fn find(shard: &PointShard) -> Result<ShardSummary<PointTotals>> {
    find_summary(shard)?.ok_or_else(|| shard.shard.not_built())
}

/// Makes sure that shards have all of the space, one behind the other, and are cut at units.
fn check_cover(head: &Path, shards: &[PointShard], encoder: &Encoder) -> Result<()> {
    let what = || format!("shards of {}", head.display());
    let level = shards.first().map_or(0, |shard| shard.level);
    if level > deepest_units(&encoder.grid) || shards.iter().any(|shard| shard.level != level) {
        let expected = format!("one level, at most {}", deepest_units(&encoder.grid));
        return Err(Error::invalid(what(), format!("units at level {level} and others"), expected));
    }
    let mut next = 0;
    for run in shards.iter().filter_map(PointShard::run) {
        let [first, last] = run.ends();
        if first != next || !run.is_cut_at(encoder.grid.dimension, level) {
            return Err(Error::invalid(
                what(),
                format!("one from {first:016x} to {last:016x}"),
                format!("{next:016x}"),
            ));
        }
        next = last + 1;
    }
    match next == CodeRun::ALL.ends()[1] + 1 {
        true => Ok(()),
        false => Err(Error::invalid(what(), format!("an end at {next:016x}"), "the whole space")),
    }
}

/// The blocks of a shard, one behind the other.
struct RunFile {
    path: PathBuf,
    file: Option<BufReader<File>>,
    bytes: Vec<u8>,
}

impl RunFile {
    fn new(path: PathBuf) -> RunFile {
        RunFile { path, file: None, bytes: Vec::new() }
    }

    /// Reads the bytes of the next block.
    fn read(&mut self, entry: &Entry) -> Result<()> {
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(BufReader::with_capacity(1 << 18, open_input(&self.path)?)),
        };
        self.bytes.clear();
        // (Room for what is there, and not for what a number says.)
        let read = file.by_ref().take(entry.block.length.into()).read_to_end(&mut self.bytes);
        read.map_err(Error::io(&self.path, "read a block"))?;
        if self.bytes.len() as u64 != u64::from(entry.block.length) {
            let (found, expected) = (self.bytes.len(), entry.block.length);
            let place = format!("block at byte {}", entry.block.offset);
            return Err(Error::corrupt(&self.path, place, format!("{found} bytes"), format!("{expected}")));
        }
        Ok(())
    }
}

//! Merges the shards of a tree: copies their blocks, and builds the nodes above the units.

use std::path::Path;

use super::units::{PointTotals, Unit, Units, find_summary};
use super::{PointShard, deepest_units};
use crate::build::{Assembler, BuildSummary, Encoder, MAX_NUMBERS, NodeSink, write_items, write_root};
use crate::store::{PointTree, PointWriter, Summary};
use spinney_base::io::Output;
use spinney_base::space::Code;
use spinney_base::{Error, Progress, Result};
use spinney_container::{RunFile, ShardSummary};

/// Merges the shards of a tree, all of which must be built. The file is byte-identical to a
/// single-process build. `head` is the path of the tree's head. Blocks are verified and copied;
/// only the points of the nodes above the units are read. About `memory` bytes hold each list
/// before it goes to a temporary file. `points` is the expected total, if known. Progress counts
/// bytes.
///
/// # Errors
/// If a shard is missing, corrupt or of another job; if shards leave gaps or overlap; if the point
/// count is wrong; if the output cannot be written; on cancellation. In these cases there is no
/// output.
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
    let mut writer = PointWriter::new(output, &encoder.grid, memory)?;
    let top = Code::root(encoder.grid.dimension);
    let mut assembler = Assembler::new(&encoder, leaf_size, top);
    let (mut summary, mut bytes) = (BuildSummary::default(), Vec::new());
    for shard in shards {
        let mut run: Option<RunFile> = None;
        let mut units = Units::new(find(shard)?, shard, &encoder, leaf_size)?;
        while let Some(unit) = units.next()? {
            progress.check()?;
            summary.points = summary.points.saturating_add(unit.points);
            if summary.points > MAX_NUMBERS {
                let found = format!("{} or more points", summary.points);
                return Err(units.corrupt(found, format!("at most {MAX_NUMBERS} in a file")));
            }
            let Unit { code, assembled, blocks, nodes, .. } = unit;
            assembler.reach(code, &assembled.closed);
            write_items(std::mem::take(&mut assembler.items), &mut writer)?;
            for entry in &blocks {
                let run = match &mut run {
                    Some(run) => run,
                    none => {
                        let path = shard.shard.run_path(0);
                        none.insert(RunFile::new(&path, shard.shard.access.input(&path)?))
                    }
                };
                run.read(entry.block.length.into(), &mut bytes)?;
                writer.copy(&bytes, entry, run.path())?;
                progress.advance(entry.block.length.into(), total);
            }
            for (code, statistics) in &nodes {
                writer.node(*code, statistics)?;
            }
            assembler.join(code, assembled);
            write_items(std::mem::take(&mut assembler.items), &mut writer)?;
        }
        // The points of the units equal the totals, so the duplicates do not exceed the points.
        summary.duplicates += units.totals().duplicates;
    }
    if points.is_some_and(|points| points != summary.points) {
        let expected = format!("{}, as in the headers of the inputs", points.unwrap_or_default());
        return Err(Error::corrupt(head, "points of all shards", summary.points.to_string(), expected));
    }
    let (assembled, items) = assembler.finish();
    write_items(items, &mut writer)?;
    write_root(&encoder, assembled.closed, &mut writer)?;
    writer.finish(&Summary::new(&encoder, leaf_size, summary), planned.metadata())?;
    Ok(summary)
}

fn find(shard: &PointShard) -> Result<ShardSummary<PointTotals>> {
    find_summary(shard)?.ok_or_else(|| shard.shard.not_built())
}

/// Checks that the shards cover space contiguously and are cut at units.
fn check_cover(head: &Path, shards: &[PointShard], encoder: &Encoder) -> Result<()> {
    let what = || format!("shards of {}", head.display());
    let level = shards.first().map_or(0, |shard| shard.level);
    if level > deepest_units(&encoder.grid) || shards.iter().any(|shard| shard.level != level) {
        let expected = format!("one level, at most {}", deepest_units(&encoder.grid));
        return Err(Error::invalid(what(), format!("units at level {level} and others"), expected));
    }
    let mut runs = shards.iter().filter_map(PointShard::run);
    if let Some(run) = runs.clone().find(|run| !run.is_cut_at(encoder.grid.dimension, level)) {
        let [first, last] = run.ends();
        let found = format!("a shard of codes {first:016x} to {last:016x}");
        return Err(Error::invalid(what(), found, "ranges of whole units"));
    }
    spinney_container::check_cover(head, 0, &mut runs)
}

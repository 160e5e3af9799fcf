//! Builds a shard of a point tree.

use std::path::Path;

use super::cut::{may_have, subsets_of};
use super::writer::ShardWriter;
use super::{PointShard, deepest_units, unit_of};
use crate::attribute::position_of;
use crate::build::{
    Assembler, BATCH, BucketedRows, Buckets, BuildSummary, Encoder, Plan, Work, encoder_of, write_items,
};
use crate::import::PointImport;
use crate::source::PointSubset;
use crate::store::{PointTree, PointWriter, Summary};
use spinney_base::io::{FileAccess, Output};
use spinney_base::space::CodeRange;
use spinney_base::{Error, Progress, Result};
use spinney_container::Metadata;

/// Writes the head of a sharded build: a tree without points, with all metadata of the result.
/// Shards are checked against it, and merging needs nothing else.
///
/// # Errors
/// If the output cannot be written.
pub fn write_head(import: &PointImport, output: Output) -> Result<()> {
    let encoder = encoder_of(import.source.schema());
    let writer = PointWriter::new(output, &encoder.grid, 0)?;
    writer.finish(&summary_of(import, &encoder), &import.metadata)
}

fn summary_of(import: &PointImport, encoder: &Encoder) -> Summary {
    Summary::new(encoder, import.options.leaf_size, BuildSummary::default())
}

/// Builds a shard of an import; `head` is the path of the tree's head. Reads all files that may
/// have points in the shard, in full, and no others. `check` verifies that the files are unchanged,
/// before the shard is published.
///
/// # Errors
/// If a file cannot be read, or has points outside the bounds of its header; if the files or
/// options differ from those of the head; if the output cannot be written; those of `check`. An
/// incomplete shard is never used.
pub fn build_shard(
    import: &PointImport,
    (head, shard): (&Path, &PointShard),
    check: &dyn Fn() -> Result<()>,
    progress: &dyn Progress,
) -> Result<()> {
    import.options.check()?;
    let encoder = encoder_of(import.source.schema());
    check_planned(import, &encoder, (head, &shard.shard.access))?;
    if shard.level > deepest_units(&encoder.grid) {
        let expected = format!("at most {}", deepest_units(&encoder.grid));
        return Err(Error::invalid("shard level", shard.level.to_string(), expected));
    }
    let mut writer = ShardWriter::new(shard, &encoder)?;
    let Some(run) = shard.run() else { return writer.finish(0) };
    let (rows, read) = read(import, &encoder, (shard, run), progress)?;
    let buckets = rows.buckets();
    let total = read + buckets.iter().map(|bucket| bucket.rows).sum::<u64>();
    let (mut last, mut duplicates) = (None, 0);
    for buckets in buckets.chunk_by(|a, b| a.code.ancestor(shard.level) == b.code.ancestor(shard.level)) {
        let unit = buckets[0].code.ancestor(shard.level);
        writer.begin_unit(unit)?;
        let plan = Plan { encoder: &encoder, options: &import.options, progress };
        let mut work =
            Work { plan, temporary: &shard.shard.directory, sink: &mut writer, total, duplicates: 0 };
        let mut assembler = Assembler::new(&encoder, import.options.leaf_size, unit);
        work.assemble((&rows, buckets), &mut assembler, &mut last)?;
        duplicates += work.duplicates;
        let (assembled, items) = assembler.finish();
        write_items(items, &mut writer)?;
        writer.end_unit(assembled)?;
    }
    check()?;
    writer.finish(duplicates)
}

/// Builds a shard without units, for which no space is left; `head` is the path of the tree's head.
///
/// # Errors
/// If the head cannot be read, or the shard cannot be written.
pub fn build_empty_shard(head: &Path, shard: &PointShard) -> Result<()> {
    let planned = PointTree::open(head, &(&shard.shard.access).into())?;
    let encoder = Encoder::new(planned.layout().clone(), planned.grid().clone());
    ShardWriter::new(shard, &encoder)?.finish(0)
}

/// Checks that the build matches the head, except for the paths of the inputs.
fn check_planned(
    import: &PointImport,
    encoder: &Encoder,
    (head, access): (&Path, &FileAccess),
) -> Result<()> {
    let planned = PointTree::open(head, &access.into())?;
    // Metadata is compared as bytes, in which NaN equals itself.
    let comparable =
        |metadata: &Metadata| Metadata { provenance: Vec::new(), ..metadata.clone() }.to_bytes(head);
    let summary = summary_of(import, encoder);
    let found = match () {
        () if summary != *planned.summary() => format!("a tree of {summary:?}"),
        () if *planned.grid() != encoder.grid => format!("a grid in {} axes", encoder.grid.dimension.axes()),
        () if comparable(&import.metadata)? != comparable(planned.metadata())? => "other metadata".into(),
        () => return Ok(()),
    };
    let (path, expected) = (head.to_path_buf(), format!("{:?}", planned.summary()));
    let advice = "the inputs or the program have changed: plan a new job in another directory";
    Err(Error::PlanMismatch { path, found, expected, advice })
}

/// Reads the points of a run; returns the number of points read, including those outside the run.
fn read(
    import: &PointImport,
    encoder: &Encoder,
    (shard, run): (&PointShard, CodeRange),
    progress: &dyn Progress,
) -> Result<(BucketedRows, u64)> {
    let grid = &encoder.grid;
    let [first, last] = run.ends().map(|end| unit_of(grid.dimension, shard.level, end));
    let top = (first.common_ancestor(last), grid.code_levels());
    let directory = shard.shard.directory.clone();
    let mut buckets = Buckets::new(directory, encoder.stride(), top, import.options.memory / 3);
    let (subsets, wanted) = (import.source.subsets(), subsets_of(import, shard));
    let total: u64 = wanted.iter().map(|number| subsets[*number].count).sum();
    let mut read = 0;
    let mut rows = Vec::new();
    for number in wanted {
        let subset = &subsets[number];
        let mut points = import.source.subset(number)?;
        // Invariant: points are numbered in input order in all shards. Each file reserves as many
        // numbers as it has points.
        let mut next: u64 = subsets[..number].iter().map(|subset| subset.count).sum();
        let end = next + subset.count;
        loop {
            progress.check()?;
            rows.clear();
            let count = points.read(&mut rows, BATCH)?;
            if count == 0 {
                break;
            }
            for point in rows.chunks_exact(encoder.layout.size) {
                let position = position_of(point);
                let code = grid.code(position).filter(|_| may_have(subset, position) && next < end);
                let code = code.ok_or_else(|| beyond(points.path(), subset))?;
                if run.contains(code) {
                    buckets.push(code, point, next.to_le_bytes().first_chunk().expect("fewer than eight"))?;
                }
                next += 1;
            }
            progress.advance(count as u64, 2 * total);
        }
        read += subset.count;
    }
    Ok((buckets.finish()?, read))
}

/// Error for points outside the bounds by which files are assigned to shards.
fn beyond(path: &Path, subset: &PointSubset) -> Error {
    let [least, most] = subset.bounds;
    let PointSubset { count, .. } = subset;
    let expected = format!(
        "{count} points from {least:?} to {most:?} on the grid, as in its header (unsharded `spinney build` reads all points to find their bounds)"
    );
    Error::corrupt(path, "points", "other points than its header declares", expected)
}

//! Merges the shards of a file: their segments in order, then the top levels and the segment index.

use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::file_writer::FileWriter;
use super::reader::Goblin;
use super::segment_builder::SegmentBuilder;
use super::shard_writer::planned_layers;
use super::summary_items::{Item, Items};
use crate::store::builder::TreeSink;
use spinney_base::io::{CompletionRecord, FileAccess, MAX_RECORD, Output, url_of};
use spinney_base::{Error, Progress, Result};
use spinney_container::{
    FileHeader, Header, LevelCounts, RangeSummary, RunFile, Shard, ShardSummary, check_cover,
    check_tree_name, create_tree_file,
};

/// Summary of a shard of trees of cells, and of its run of one layer.
type Summary = ShardSummary<LevelCounts>;
type RunSummary = RangeSummary<LevelCounts>;

/// The file that shards are merged into, and whether the shards' files are removed.
pub enum MergeOutput {
    /// A file that appears at its final path at the end; the shards' files are kept.
    Keep(Output),
    /// A [resumable](Output::resumable) file, and the number of its bytes that already exist. Each
    /// run file is removed as soon as all of its bytes are durable in the output, so that the disk
    /// needs space for only one of both. An aborted merge is resumed with the same output: bytes of
    /// removed run files are read from there, and checked.
    Remove(Output, u64),
}

impl From<Output> for MergeOutput {
    fn from(output: Output) -> MergeOutput {
        MergeOutput::Keep(output)
    }
}

impl MergeOutput {
    /// Starts a file at a path, optionally with a maximum size of `limit` bytes. The shards' files
    /// are kept unless `removes` is set.
    ///
    /// # Errors
    /// Those of [`create_tree_file`] and [`Output::resumable`].
    pub fn create(
        path: &Path,
        limit: Option<u64>,
        removes: bool,
        access: &FileAccess,
    ) -> Result<MergeOutput> {
        if !removes {
            return create_tree_file(path, access).map(|output| MergeOutput::Keep(output.with_limit(limit)));
        }
        check_tree_name(path)?;
        let is_other = std::fs::metadata(path).is_ok_and(|there| !there.is_file());
        if path == Path::new("-") || is_other {
            let advice = "name a local file, or keep the shards";
            return Err(Error::unsupported(path, "removing shards while merging into a stream", advice));
        }
        let (output, there) = Output::resumable(path)?;
        Ok(MergeOutput::Remove(output.with_limit(limit).with_access(access), there))
    }

    /// Returns the final path of the file.
    pub fn path(&self) -> &Path {
        let (MergeOutput::Keep(output) | MergeOutput::Remove(output, _)) = self;
        output.path()
    }

    /// Returns how the file is read and written.
    pub fn access(&self) -> &FileAccess {
        let (MergeOutput::Keep(output) | MergeOutput::Remove(output, _)) = self;
        output.access()
    }

    /// Returns the summaries of complete shards that a merge to this output can use: some of their
    /// run files may already be in the output.
    ///
    /// # Errors
    /// Those of [`ShardSummary::find_all`].
    pub fn find(&self, shards: &[Shard]) -> Result<Vec<Result<Option<Summary>>>> {
        match self {
            MergeOutput::Keep(_) => ShardSummary::find_all(shards),
            MergeOutput::Remove(..) => Ok(shards.iter().map(ShardSummary::find_without_runs).collect()),
        }
    }

    /// Removes the output if nothing was written.
    pub fn abandon(self) {
        if let MergeOutput::Remove(output, 0) = &self
            && let Some(path) = output.unfinished_path()
        {
            let _ = std::fs::remove_file(mark_of(path));
            let _ = std::fs::remove_file(path);
        }
    }

    /// Returns the job of a merge with removal of shards that moved the output to its final path
    /// and was aborted then, and the mark file that records this, which is removed last. `None` if
    /// there is none.
    ///
    /// # Errors
    /// If the file or its mark cannot be read.
    pub fn finished(path: &Path) -> Result<Option<(u128, PathBuf)>> {
        if url_of(path).is_some() || path == Path::new("-") {
            return Ok(None);
        }
        let partial = Output::partial_path(path)?;
        let mark = mark_of(&partial);
        if partial.exists() || !mark.exists() {
            return Ok(None);
        }
        let work = CompletionRecord::work_of(&mark, path)?;
        let job = work.and_then(|work| u128::from_str_radix(&work, 16).ok());
        Ok(job.map(|job| (job, mark)))
    }

    /// Checks that existing bytes of the output are of the same job, and marks the output as this
    /// job's. Returns the mark file, to be removed when the output is at its final path; `None` if
    /// the shards' files are kept.
    ///
    /// # Errors
    /// If the bytes are of another or an unknown job; if the mark cannot be read or written.
    pub fn claim(&mut self, job: u128) -> Result<Option<PathBuf>> {
        let MergeOutput::Remove(output, there) = self else { return Ok(None) };
        let Some(partial) = output.unfinished_path() else { return Ok(None) };
        let (mark, own) = (mark_of(partial), format!("{job:032x}"));
        // Invariant: bytes that another job has written to its output may be all that is left of
        // its shards, and are never overwritten. So the mark is written before the first byte.
        if *there == 0 {
            let mut file = output.access().create(&mark)?;
            file.write_all(own.as_bytes()).map_err(Error::io(&mark, "write"))?;
            file.commit()?;
        } else if !output
            .access()
            .read_whole(&mark, MAX_RECORD)?
            .is_some_and(|text| text.starts_with(own.as_bytes()))
        {
            let advice = "finish that merge, remove the file, or choose another output";
            let found = "merging shards into the unfinished output of another merge";
            return Err(Error::unsupported(partial, found, advice));
        }
        output.record_completion(CompletionRecord { path: mark.clone(), work: own });
        Ok(Some(mark))
    }
}

/// Returns the mark file, which records the job of an unfinished output, and later that the output
/// is complete.
fn mark_of(partial: &Path) -> PathBuf {
    let mut mark = partial.as_os_str().to_owned();
    mark.push(".job");
    mark.into()
}

/// Merges complete shards: the output is byte-identical to a file that was built in a single
/// process. `head` is the file with headers and metadata of the layers. Segments are checked and
/// copied. The segment index uses about `memory` bytes before it goes to temporary files. Progress
/// counts bytes.
///
/// # Errors
/// If a shard is missing, corrupt or of another job, if shards leave gaps or overlap, if the output
/// cannot be written, or on cancellation. There is no output then.
///
/// `head` is read with the access of the shards.
pub fn merge_shards(
    head: &Path,
    shards: &[Shard],
    output: MergeOutput,
    memory: u64,
    progress: &dyn Progress,
) -> Result<()> {
    merge_with(head, shards, (output, memory), None, progress)
}

/// Merges the shards of an index: see [`merge_shards`]. `references` are the sections that describe
/// the files that have the cells: see
/// [`TreeWriter::set_references`](crate::store::TreeWriter::set_references).
///
/// # Errors
/// Those of [`merge_shards`].
pub fn merge_index_shards(
    head: &Path,
    shards: &[Shard],
    (output, memory): (MergeOutput, u64),
    references: (Vec<u8>, Vec<u8>),
    progress: &dyn Progress,
) -> Result<()> {
    merge_with(head, shards, (output, memory), Some(references), progress)
}

fn merge_with(
    head: &Path,
    shards: &[Shard],
    (output, memory): (MergeOutput, u64),
    references: Option<(Vec<u8>, Vec<u8>)>,
    progress: &dyn Progress,
) -> Result<()> {
    let access = shards.first().map_or(output.access(), |shard| &shard.access);
    let planned = Goblin::open(head, &access.into())?;
    let layers = planned_layers(&planned)?;
    let summaries = find_summaries(shards, &output)?;
    let total = summaries.iter().fold(0, |sum: u64, summary| sum.saturating_add(summary.run_bytes()));
    let file = FileHeader::read_cells(head, &*planned.file.backend)?;
    let (mut output, there) = match output {
        MergeOutput::Keep(output) => (output, None),
        MergeOutput::Remove(output, there) => {
            let partial = output.unfinished_path().map(Path::to_path_buf);
            (output, partial.map(|path| Partial { path, bytes: there }))
        }
    };
    output.expect(total);
    let mut out = FileWriter::over(output, there.as_ref().map_or(0, |there| there.bytes), file)?;
    for (number, (header, metadata)) in (0..).zip(&layers) {
        let ranges: Vec<_> =
            shards.iter().zip(&summaries).filter_map(|both| find_run(both, number)).collect();
        // Invariant: runs are cut at `shard_level`, and a layer's segments below it are stored in
        // the order of codes. So the concatenated runs of all shards are those of a file that was
        // built in a single process, and only the levels above remain to be built.
        check_cover(head, number, &mut ranges.iter().map(|(_, _, range)| range.range.run))?;
        let mut position = out.position();
        out.merged_layer(header, metadata, memory, &mut |builder| {
            let mut counts = LevelCounts::default();
            for (shard, summary, range) in &ranges {
                let path = shard.run_path(number);
                let run =
                    RunLocation { path: &path, position, partial: there.as_ref(), access: &shard.access };
                copy_run(run, (summary, range, header), builder, (total, progress))?;
                counts.merge(&checked_counts(summary, range, header)?);
                position += range.run_bytes;
                if there.is_some() && range.run_bytes > 0 {
                    // Invariant: each byte of a shard is durable in at least one of both files,
                    // whenever the process or the machine fails.
                    builder.sync()?;
                    shard.access.remove(&[&path])?;
                }
            }
            Ok(counts)
        })?;
    }
    if let Some((sources, pages)) = references {
        out.set_references(sources, pages);
    }
    out.finish()
}

/// A shard's run of a layer: the shard, its summary, and the summary of the run.
type ShardLayer<'a> = (&'a Shard, &'a Summary, &'a RunSummary);

fn find_run<'a>((shard, summary): (&'a Shard, &'a Summary), layer: u32) -> Option<ShardLayer<'a>> {
    let range = summary.ranges.iter().find(|range| range.range.layer == layer)?;
    Some((shard, summary, range))
}

fn find_summaries(shards: &[Shard], output: &MergeOutput) -> Result<Vec<Summary>> {
    let found =
        shards.iter().zip(output.find(shards)?).map(|(shard, found)| found?.ok_or_else(|| shard.not_built()));
    found.collect()
}

/// Checks and returns the node counts of a shard's run.
fn checked_counts(summary: &Summary, range: &RunSummary, header: &Header) -> Result<LevelCounts> {
    let (run, shard_level) = (range.range.run, header.shape.shard_level());
    for (level, nodes) in (0..).zip(range.totals.levels()) {
        let most = if level > shard_level && level <= header.depth() {
            run.nodes(header.form.dimension, level)
        } else {
            0
        };
        if nodes.iter().any(|nodes| *nodes > most) {
            let found = format!("{nodes:?} nodes at level {level}");
            return Err(Error::corrupt(
                summary.path(),
                "totals",
                found,
                format!("at most {most} of each state"),
            ));
        }
    }
    Ok(range.totals.clone())
}

/// Copies the segments of a shard's run, and pushes its parts.
fn copy_run(
    place: RunLocation<'_>,
    (summary, range, header): (&Summary, &RunSummary, &Header),
    builder: &mut SegmentBuilder<'_>,
    (total, progress): (u64, &dyn Progress),
) -> Result<()> {
    let mut run = None;
    let mut items = Items::of(summary, range, header)?;
    let mut bytes = Vec::new();
    while let Some(item) = items.next()? {
        match item {
            Item::Segment(entry) => {
                progress.check()?;
                let run = match &mut run {
                    Some(run) => run,
                    none => none.insert(open_run(place, range.run_bytes)?),
                };
                run.read(entry.length, &mut bytes)?;
                let found = crc32c::crc32c(&bytes);
                if found != entry.checksum {
                    let expected = format!("{:08x}", entry.checksum);
                    return Err(Error::corrupt(
                        run.path(),
                        "segment",
                        format!("checksum {found:08x}"),
                        expected,
                    ));
                }
                builder.pass(&bytes, entry)?;
                progress.advance(bytes.len() as u64, total);
            }
            Item::Top(part) => builder.push((part, None, LevelCounts::default()))?,
        }
    }
    Ok(())
}

/// An output that is being merged, and the number of its bytes from an earlier attempt.
struct Partial {
    path: PathBuf,
    bytes: u64,
}

/// Location of a run of segments: a file of its own, or, if that was removed, the output from a
/// position on.
#[derive(Clone, Copy)]
struct RunLocation<'a> {
    path: &'a Path,
    position: u64,
    partial: Option<&'a Partial>,
    access: &'a FileAccess,
}

/// Opens the segments of a shard's run, which have `length` bytes.
fn open_run(
    RunLocation { path, position, partial, access }: RunLocation<'_>,
    length: u64,
) -> Result<RunFile> {
    if let Some(partial) = partial
        && access.find(path)?.is_none()
    {
        let end = position.checked_add(length);
        if end.is_none_or(|end| end > partial.bytes) {
            let found =
                format!("a shard whose segments are neither at this path nor in {}", partial.path.display());
            return Err(Error::unsupported(path, found, "build the shard again"));
        }
        let mut file = access.input(&partial.path)?;
        file.seek(SeekFrom::Start(position)).map_err(Error::io(&partial.path, "read"))?;
        return Ok(RunFile::new(&partial.path, file));
    }
    let file = access.input(path)?;
    let found = file.len();
    if found != length {
        return Err(Error::corrupt(path, "length", format!("{found} bytes"), format!("{length} bytes")));
    }
    Ok(RunFile::new(path, file))
}

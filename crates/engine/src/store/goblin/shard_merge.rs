//! Puts the shards of a file together: their segments one behind the other, then the crown and the directory.

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
    FileHeader, Header, LevelCounts, PieceSummary, RunFile, Shard, ShardSummary, check_cover,
    check_tree_name, create_tree_file,
};

/// Summary of a shard of trees of cells, and of one of its pieces.
type Summary = ShardSummary<LevelCounts>;
type Piece = PieceSummary<LevelCounts>;

/// The file that shards are put together to, and what becomes of their own.
pub enum MergeOutput {
    /// A file that appears in the end; shards stay.
    Keep(Output),
    /// A file that is [resumable](Output::resumable), and the bytes that are there of it: each run file is removed as soon as all of it is on the disk there,
    /// so that there is room for one of both. Whoever is cut off goes on with the same output; what was removed is read from there, and checked.
    Remove(Output, u64),
}

impl From<Output> for MergeOutput {
    fn from(output: Output) -> MergeOutput {
        MergeOutput::Keep(output)
    }
}

impl MergeOutput {
    /// Starts a file at a path, with at most so many bytes if a number is given. Shards stay unless they are to be removed.
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
            let advice = "name a file, or let shards stay";
            return Err(Error::unsupported(path, "removing shards whose bytes go to a stream", advice));
        }
        let (output, there) = Output::resumable(path)?;
        Ok(MergeOutput::Remove(output.with_limit(limit).with_access(access), there))
    }

    /// How the file is read and written.
    fn access(&self) -> &FileAccess {
        let (MergeOutput::Keep(output) | MergeOutput::Remove(output, _)) = self;
        output.access()
    }

    /// The summaries of shards that are made, as far as a merge to this output can use them: some of their run files may be in the output already.
    ///
    /// # Errors
    /// Those of [`ShardSummary::find_all`].
    pub fn find(&self, shards: &[Shard]) -> Result<Vec<Result<Option<Summary>>>> {
        match self {
            MergeOutput::Keep(_) => ShardSummary::find_all(shards),
            MergeOutput::Remove(..) => Ok(shards.iter().map(ShardSummary::find_without_runs).collect()),
        }
    }

    /// Leaves nothing behind where nothing was written.
    pub fn abandon(self) {
        if let MergeOutput::Remove(output, 0) = &self
            && let Some(path) = output.unfinished_path()
        {
            let _ = std::fs::remove_file(mark_of(path));
            let _ = std::fs::remove_file(path);
        }
    }

    /// The job, by the mark of its shards, whose merge has put a file in its place, removing shards, and was cut off then; and the file that says
    /// so, which is removed last. `None` if there is none.
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

    /// Makes sure that what is there of the file was begun by the same job, and marks it as this one's. Returns the mark, a file that is to be removed when the
    /// output is in its place; nothing if shards stay.
    ///
    /// # Errors
    /// If it is that of another job, or nobody knows whose; if the mark cannot be read or written.
    pub fn claim(&mut self, job: u128) -> Result<Option<PathBuf>> {
        let MergeOutput::Remove(output, there) = self else { return Ok(None) };
        let Some(partial) = output.unfinished_path() else { return Ok(None) };
        let (mark, own) = (mark_of(partial), format!("{job:032x}"));
        // Invariant: what another job has put into its file may be all that is left of its shards, and is not written over. So the mark is there before the
        // first byte is.
        if *there == 0 {
            let mut file = output.access().create(&mark)?;
            file.write_all(own.as_bytes()).map_err(Error::io(&mark, "write"))?;
            file.commit()?;
        } else if !output
            .access()
            .read_whole(&mark, MAX_RECORD)?
            .is_some_and(|text| text.starts_with(own.as_bytes()))
        {
            let advice = "finish the merge that has begun it, remove it, or choose another output";
            let found = "putting shards together where a file of something else was begun";
            return Err(Error::unsupported(partial, found, advice));
        }
        output.record_completion(CompletionRecord { path: mark.clone(), work: own });
        Ok(Some(mark))
    }
}

/// The file that says which job has begun a file that is not in its place yet, and then that it is whole.
fn mark_of(partial: &Path) -> PathBuf {
    let mut mark = partial.as_os_str().to_owned();
    mark.push(".job");
    mark.into()
}

/// Puts a file together whose shards are all made: the bytes are those of a file that was built in one go. `head` is the file that tells of
/// its layers. Segments are checked and copied; about `memory` bytes hold the directory before it goes to temporary files.
/// Progress counts bytes.
///
/// # Errors
/// If a shard is missing, damaged or of another job, if shards leave gaps or overlap, or if the output cannot be written; on
/// interruption. There is no output then.
///
/// `head` is read with the access of the shards.
pub fn merge_shards(
    head: &Path,
    shards: &[Shard],
    output: MergeOutput,
    memory: u64,
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
        let pieces: Vec<_> =
            shards.iter().zip(&summaries).filter_map(|both| find_piece(both, number)).collect();
        // Invariant: runs cut the space at the crown's level, and a layer's segments below it stand in the order of codes. So the runs of all shards, one
        // behind the other, are those of a file that was built in one go, and all that is left to make is what stands above.
        check_cover(head, number, &mut pieces.iter().map(|(_, _, piece)| piece.piece.run))?;
        let mut position = out.position();
        out.merged_layer(header, metadata, memory, &mut |builder| {
            let mut counts = LevelCounts::default();
            for (shard, summary, piece) in &pieces {
                let path = shard.run_path(number);
                let run = RunPlace { path: &path, position, partial: there.as_ref(), access: &shard.access };
                copy_piece(run, (summary, piece, header), builder, (total, progress))?;
                counts.merge(&checked_counts(summary, piece, header)?);
                position += piece.run_bytes;
                if there.is_some() && piece.run_bytes > 0 {
                    // Invariant: each byte of a shard is on the disk in one of both files at least, whenever the process or the machine ends.
                    builder.sync()?;
                    shard.access.remove(&[&path])?;
                }
            }
            Ok(counts)
        })?;
    }
    out.finish()
}

/// A piece of a layer: the shard that it is in, and what is known of it.
type Found<'a> = (&'a Shard, &'a Summary, &'a Piece);

fn find_piece<'a>((shard, summary): (&'a Shard, &'a Summary), layer: u32) -> Option<Found<'a>> {
    let piece = summary.pieces.iter().find(|piece| piece.piece.layer == layer)?;
    Some((shard, summary, piece))
}

fn find_summaries(shards: &[Shard], output: &MergeOutput) -> Result<Vec<Summary>> {
    let found =
        shards.iter().zip(output.find(shards)?).map(|(shard, found)| found?.ok_or_else(|| shard.not_built()));
    found.collect()
}

/// The nodes that a piece has counted.
fn checked_counts(summary: &Summary, piece: &Piece, header: &Header) -> Result<LevelCounts> {
    let (run, crown) = (piece.piece.run, header.shape.crown_level());
    for (level, nodes) in (0..).zip(piece.totals.levels()) {
        let most = if level > crown && level <= header.depth() {
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
                format!("at most {most} of a state"),
            ));
        }
    }
    Ok(piece.totals.clone())
}

/// Copies the segments of a piece, and hands its parts over.
fn copy_piece(
    place: RunPlace<'_>,
    (summary, piece, header): (&Summary, &Piece, &Header),
    builder: &mut SegmentBuilder<'_>,
    (total, progress): (u64, &dyn Progress),
) -> Result<()> {
    let mut run = None;
    let mut items = Items::of(summary, piece, header)?;
    let mut bytes = Vec::new();
    while let Some(item) = items.next()? {
        match item {
            Item::Segment(entry) => {
                progress.check()?;
                let run = match &mut run {
                    Some(run) => run,
                    none => none.insert(open_run(place, piece.run_bytes)?),
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

/// A file that is being put together, and what it has from an earlier try.
struct Partial {
    path: PathBuf,
    bytes: u64,
}

/// The place of a run of segments: a file of its own, or, where that is removed, the file that is put together, from a byte on.
#[derive(Clone, Copy)]
struct RunPlace<'a> {
    path: &'a Path,
    position: u64,
    partial: Option<&'a Partial>,
    access: &'a FileAccess,
}

/// Opens the segments of a piece, which take `length` bytes.
fn open_run(RunPlace { path, position, partial, access }: RunPlace<'_>, length: u64) -> Result<RunFile> {
    if let Some(partial) = partial
        && access.find(path)?.is_none()
    {
        let end = position.checked_add(length);
        if end.is_none_or(|end| end > partial.bytes) {
            let found = format!("a shard whose segments are neither here nor in {}", partial.path.display());
            return Err(Error::unsupported(path, found, "build it again"));
        }
        let mut file = access.input(&partial.path)?;
        file.seek(SeekFrom::Start(position)).map_err(Error::io(&partial.path, "read"))?;
        return Ok(RunFile::new(&partial.path, file));
    }
    let file = access.input(path)?;
    let found = file.len();
    if found != length {
        return Err(Error::corrupt(path, "length", format!("{found} bytes"), format!("{length}")));
    }
    Ok(RunFile::new(path, file))
}

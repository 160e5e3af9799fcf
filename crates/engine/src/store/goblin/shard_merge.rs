//! Puts the shards of a file together: their segments one behind the other, then the crown and the directory.

use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use super::file_writer::FileWriter;
use super::light_file::{LightFile, LightPiece};
use super::light_items::{Item, Items};
use super::reader::Goblin;
use super::segment_builder::SegmentBuilder;
use super::shard::Shard;
use super::shard_writer::planned_layers;
use crate::store::builder::TreeSink;
use spinney_base::io::{InputFile, Output};
use spinney_base::space::CodeRun;
use spinney_base::{Error, Progress, Result};
use spinney_container::{FileHeader, Header, LevelCounts, OpenOptions};
use spinney_packing::Effort;

/// Puts a file together whose shards are all made: the bytes are those of a file that was built in one go. `head` is the file that tells of
/// its layers. Segments are checked and copied; about `memory` bytes hold the directory before it goes to temporary files, and the crown
/// is packed with `effort` where the layers are. Progress counts bytes.
///
/// # Errors
/// If a shard is missing, damaged or of another job, if shards leave gaps or overlap, or if the output cannot be written; on
/// interruption. There is no output then.
pub fn merge_shards(
    head: &Path,
    shards: &[Shard],
    mut output: Output,
    (memory, effort): (u64, Effort),
    progress: &dyn Progress,
) -> Result<()> {
    let planned = Goblin::open(head, &OpenOptions::default())?;
    let layers = planned_layers(&planned)?;
    let lights = find_lights(shards)?;
    let total = lights.iter().fold(0, |sum: u64, light| sum.saturating_add(light.run_bytes()));
    let file = FileHeader::read_cells(head, &*planned.file.backend)?;
    output.expect(total);
    let mut out = FileWriter::new(output, file)?;
    for (number, (header, metadata)) in (0..).zip(&layers) {
        let pieces: Vec<_> = shards.iter().zip(&lights).filter_map(|both| find_piece(both, number)).collect();
        // Invariant: runs cut the space at the crown's level, and a layer's segments below it stand in the order of codes. So the runs of all shards, one
        // behind the other, are those of a file that was built in one go, and all that is left to make is what stands above.
        check_cover(head, number, pieces.iter().map(|(_, _, piece)| piece.piece.run))?;
        out.merged_layer(header, metadata, (memory, effort), &mut |builder| {
            let mut counts = LevelCounts::default();
            for (shard, light, piece) in &pieces {
                let run = shard.run_path(number);
                copy_piece(&run, (light, piece, header), builder, (total, progress))?;
                counts.merge(&checked_counts(light, piece, header)?);
            }
            Ok(counts)
        })?;
    }
    out.finish()
}

/// A piece of a layer: the shard that it is in, and what is known of it.
type Found<'a> = (&'a Shard, &'a LightFile, &'a LightPiece);

fn find_piece<'a>((shard, light): (&'a Shard, &'a LightFile), layer: u32) -> Option<Found<'a>> {
    let piece = light.pieces.iter().find(|piece| piece.piece.layer == layer)?;
    Some((shard, light, piece))
}

fn find_lights(shards: &[Shard]) -> Result<Vec<LightFile>> {
    let found = shards.iter().zip(LightFile::find_all(shards)?).map(|(shard, found)| {
        found?.ok_or_else(|| {
            let path = shard.light_path();
            Error::unsupported(path, "a file of which a shard is not made", "build this shard first")
        })
    });
    found.collect()
}

/// Makes sure that runs have all of a layer's space, one behind the other.
fn check_cover(head: &Path, layer: u32, runs: impl Iterator<Item = CodeRun>) -> Result<()> {
    let mut next = 0;
    for run in runs {
        let [first, last] = run.ends();
        if first != next {
            let found = format!("a shard of layer {layer} that begins at {first:016x}");
            return Err(Error::invalid(
                format!("shards of {}", head.display()),
                found,
                format!("{next:016x}"),
            ));
        }
        next = last + 1;
    }
    match next == CodeRun::ALL.ends()[1] + 1 {
        true => Ok(()),
        false => {
            let found = format!("shards of layer {layer} that end before {next:016x}");
            Err(Error::invalid(format!("shards of {}", head.display()), found, "the whole space"))
        }
    }
}

/// The nodes that a piece has counted.
fn checked_counts(light: &LightFile, piece: &LightPiece, header: &Header) -> Result<LevelCounts> {
    let (run, crown) = (piece.piece.run, header.shape.crown_level());
    for (level, nodes) in (0..).zip(piece.counts.levels()) {
        let most = if level > crown && level <= header.depth() {
            run.nodes(header.form.dimension, level)
        } else {
            0
        };
        if nodes.iter().any(|nodes| *nodes > most) {
            let found = format!("{nodes:?} nodes at level {level}");
            return Err(Error::corrupt(&light.path, "table", found, format!("at most {most} of a state")));
        }
    }
    Ok(piece.counts.clone())
}

/// Copies the segments of a piece, and hands its parts over.
fn copy_piece(
    path: &Path,
    (light, piece, header): (&LightFile, &LightPiece, &Header),
    builder: &mut SegmentBuilder<'_>,
    (total, progress): (u64, &dyn Progress),
) -> Result<()> {
    let mut run = None;
    let mut items = Items::of(light, piece, header)?;
    let mut bytes = Vec::new();
    while let Some(item) = items.next()? {
        match item {
            Item::Segment(entry) => {
                progress.check()?;
                let run = match &mut run {
                    Some(run) => run,
                    none => none.insert(RunFile::open(path, piece.run_bytes)?),
                };
                run.read(entry.length, entry.checksum, &mut bytes)?;
                builder.pass(&bytes, entry)?;
                progress.advance(bytes.len() as u64, total);
            }
            Item::Top(part) => builder.push((part, None, LevelCounts::default()))?,
        }
    }
    Ok(())
}

/// The segments of a piece, one behind the other.
struct RunFile {
    path: PathBuf,
    file: BufReader<InputFile>,
}

impl RunFile {
    fn open(path: &Path, length: u64) -> Result<RunFile> {
        let file = InputFile::open(path)?;
        let found = file.len();
        if found != length {
            return Err(Error::corrupt(path, "length", format!("{found} bytes"), format!("{length}")));
        }
        Ok(RunFile { path: path.to_path_buf(), file: BufReader::with_capacity(1 << 18, file) })
    }

    /// Reads the next segment, which has so many bytes and this checksum.
    fn read(&mut self, length: u64, checksum: u32, bytes: &mut Vec<u8>) -> Result<()> {
        bytes.clear();
        let read = self.file.by_ref().take(length).read_to_end(bytes);
        read.map_err(Error::io(&self.path, "read a segment"))?;
        let found = crc32c::crc32c(bytes);
        if bytes.len() as u64 != length || found != checksum {
            let expected = format!("{length} bytes with checksum {checksum:08x}");
            let found = format!("{} with {found:08x}", bytes.len());
            return Err(Error::corrupt(&self.path, "segment", found, expected));
        }
        Ok(())
    }
}

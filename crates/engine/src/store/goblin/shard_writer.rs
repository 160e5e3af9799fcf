//! Writes a shard of a file: the segments of its pieces to run files, and everything else that merging needs to a shard summary.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::directory::Entry;
use super::held::file_order;
use super::layer_writer::with_entry;
use super::reader::Goblin;
use super::segment_builder::SegmentBuilder;
use super::segment_sink::SegmentSink;
use super::summary_items::{PendingEntries, has_cells, write_top};
use crate::store::builder::{BuildOptions, Fill, Part, SealedSegment};
use spinney_base::io::Output;
use spinney_base::space::CodeRun;
use spinney_base::{Error, Result};
use spinney_container::{Codec, Header, LevelCounts, Metadata, Shard, ShardPiece, SummaryWriter};

/// A shard being written. It is made when [`ShardWriter::finish`] returns; until then nobody takes what is there for it.
pub(in crate::store) struct ShardWriter {
    shard: Shard,
    /// The file with the planned layers, of which nothing is there but what is told of them.
    head: PathBuf,
    /// Headers and metadata of these layers.
    planned: Vec<(Header, Metadata)>,
    summary: SummaryWriter<LevelCounts>,
    /// Number of the layer that comes next.
    next: u32,
}

impl ShardWriter {
    /// Starts a shard of the file whose layers another one, without any cells, tells of.
    pub(in crate::store) fn new(head: &Goblin, shard: Shard) -> Result<ShardWriter> {
        let (planned, summary) = (planned_layers(head)?, SummaryWriter::new(&shard)?);
        Ok(ShardWriter { shard, head: head.path().to_path_buf(), planned, summary, next: 0 })
    }

    /// Whether it has no part of any layer.
    pub(in crate::store) fn is_empty(&self) -> bool {
        self.shard.pieces.is_empty()
    }

    /// The run of the next layer that the shard has, if it has something of it.
    pub(in crate::store) fn run(&self) -> Option<CodeRun> {
        self.shard.piece(self.next).map(|piece| piece.run)
    }

    /// Makes the piece of the next layer of parts that `fill` hands over, if there is one.
    pub(in crate::store) fn layer(
        &mut self,
        options: &BuildOptions,
        header: &Header,
        (covered, in_order): ([u64; 3], bool),
        fill: &mut Fill<'_>,
        complete: &mut dyn FnMut(&mut Metadata),
    ) -> Result<()> {
        let layer = self.next;
        self.next += 1;
        let mut metadata = options.metadata.clone();
        complete(&mut metadata);
        // (Who has the planned metadata in his hands has them complete.)
        self.check_planned(layer, header, &[&metadata, &options.metadata])?;
        let Some(piece) = self.shard.piece(layer).copied() else { return Ok(()) };
        let run = self.shard.run_path(layer);
        if !in_order {
            let advice = "read them in the order of FD codes, or build the file in one go";
            return Err(Error::unsupported(run, "a shard of cells that come in another order", advice));
        }
        self.summary.begin(piece);
        let mut writer = PieceWriter::new(run, piece, header, &mut self.summary);
        let mut builder = SegmentBuilder::new(header, covered, &mut writer);
        fill(&mut builder, header.shape)?;
        let (_, counts) = builder.finish();
        let bytes = writer.finish()?;
        self.summary.end(bytes, counts)
    }

    /// Makes sure that a layer is what was planned, but for where its inputs are.
    fn check_planned(&self, layer: u32, header: &Header, metadata: &[&Metadata]) -> Result<()> {
        // (As bytes, in which numbers that are none are like themselves.)
        let told = |metadata: &Metadata| -> Result<(String, Vec<u8>)> {
            let counts = Default::default();
            let alike = Metadata { counts, provenance: Vec::new(), ..metadata.clone() };
            Ok((metadata.name.clone(), alike.to_bytes(&self.head)?))
        };
        let planned = self.planned.get(layer as usize);
        let metadata = metadata.iter().map(|metadata| told(metadata)).collect::<Result<Vec<_>>>()?;
        let (found, expected) = match planned {
            Some((planned, said)) if planned == header && metadata.contains(&told(said)?) => return Ok(()),
            Some((planned, _)) if planned == header => {
                (format!("other things would be told of layer {layer}"), "what its head tells".into())
            }
            Some((planned, _)) => {
                (format!("layer {layer} would have {}", described(header)), described(planned))
            }
            None => (format!("there would be a layer {layer}"), format!("a file of {}", self.planned.len())),
        };
        let advice = "the inputs or the program have changed since: plan another job in another folder";
        Err(Error::PlanMismatch { path: self.head.clone(), found, expected, advice })
    }

    /// Says that the shard is made.
    pub(in crate::store) fn finish(self) -> Result<()> {
        self.summary.finish()
    }
}

/// A layer in a few words, for messages.
fn described(header: &Header) -> String {
    let [x, y, z] = header.extent;
    let Header { form, rule, kind, codec, .. } = header;
    let depth = header.depth();
    format!("{x} x {y} x {z} cells of {} in {depth} levels, {kind}, {rule}, {}", form.value, codec.name())
}

/// Header and metadata of each layer of a file.
pub(super) fn planned_layers(head: &Goblin) -> Result<Vec<(Header, Metadata)>> {
    let layer = |number| {
        let layer = head.open_layer(number)?;
        Ok((layer.header().clone(), layer.metadata().clone()))
    };
    (0..head.layers().len()).map(layer).collect()
}

/// Where the segments of a piece go: one behind the other to a run file, which appears when there is one.
struct PieceWriter<'l> {
    path: PathBuf,
    out: Option<Output>,
    piece: ShardPiece,
    header: Header,
    /// Bytes so far.
    position: u64,
    /// The last segment, by the order of the file.
    last: u64,
    entries: PendingEntries,
    summary: &'l mut SummaryWriter<LevelCounts>,
}

impl<'l> PieceWriter<'l> {
    fn new(
        path: PathBuf,
        piece: ShardPiece,
        header: &Header,
        summary: &'l mut SummaryWriter<LevelCounts>,
    ) -> PieceWriter<'l> {
        let header = header.clone();
        PieceWriter {
            path,
            out: None,
            piece,
            header,
            position: 0,
            last: 0,
            entries: PendingEntries::default(),
            summary,
        }
    }

    fn put(&mut self, parts: [&[u8]; 2], entry: Entry) -> Result<()> {
        let crown = self.header.shape.crown_level();
        let order = file_order(entry.code, crown);
        // Invariant: segments come in the order of the file, and none is the crown's, so that those of all shards stand in the
        // file as they stand in run files, one shard's behind the other's. Whoever puts the file together only moves them.
        debug_assert!(entry.code.level() >= crown && self.piece.run.contains(entry.code));
        debug_assert!(self.position == 0 || self.last < order, "segments come in the order of the file");
        self.last = order;
        let out = match &mut self.out {
            Some(out) => out,
            none => none.insert(self.summary.access().append_only(&self.path)?),
        };
        for part in parts {
            out.write_all(part).map_err(Error::io(&self.path, "write a segment"))?;
        }
        self.position += entry.length;
        self.entries.push(self.summary, entry)?;
        Ok(())
    }

    /// Puts the file in its place, and tells how many bytes it has.
    fn finish(mut self) -> Result<u64> {
        self.entries.write(self.summary, self.header.form.value)?;
        self.out.map_or(Ok(()), Output::commit)?;
        Ok(self.position)
    }
}

impl SegmentSink for PieceWriter<'_> {
    fn path(&self) -> &Path {
        &self.path
    }

    fn stop(&self) -> Option<u8> {
        Some(self.header.shape.crown_level())
    }

    fn top(&mut self, part: Part) -> Result<()> {
        // (What is outside of the extent is VOID without being told.)
        if !has_cells(part.code, &self.header) && !part.child.is_inner() && part.tally.cells == 0 {
            return Ok(());
        }
        write_top(self.summary, &part, &self.header)
    }

    fn codec(&self) -> Codec {
        self.header.codec
    }

    fn segment(&mut self, segment: SealedSegment) -> Result<()> {
        let header = self.header.clone();
        with_entry(&header, segment, &mut |parts, entry| self.put(parts, entry))
    }

    fn copy(&mut self, bytes: &[u8], entry: Entry) -> Result<()> {
        self.put([bytes, &[]], entry)
    }
}

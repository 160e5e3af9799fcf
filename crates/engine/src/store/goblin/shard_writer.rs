//! Writes a shard of a file: segments to a run file per layer, and everything else that merging
//! needs to a shard summary.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::deferred::file_order;
use super::directory::Entry;
use super::layer_writer::with_entry;
use super::reader::Goblin;
use super::segment_builder::SegmentBuilder;
use super::segment_sink::SegmentSink;
use super::summary_items::{PendingEntries, has_cells, write_top};
use crate::store::builder::{BuildOptions, EncodedSubtree, Fill, SealedSegment};
use spinney_base::io::Output;
use spinney_base::space::CodeRange;
use spinney_base::{Error, Result};
use spinney_container::{Codec, Header, LevelCounts, Metadata, Shard, ShardRange, SummaryWriter};

/// A shard that is being written. It is complete when [`ShardWriter::finish`] returns; files of
/// incomplete shards are ignored.
pub(in crate::store) struct ShardWriter {
    shard: Shard,
    /// The file with the planned layers, which has only their headers and metadata.
    head: PathBuf,
    /// Headers and metadata of these layers.
    planned: Vec<(Header, Metadata)>,
    summary: SummaryWriter<LevelCounts>,
    /// Index of the next layer.
    next: u32,
}

impl ShardWriter {
    /// Starts a shard of the file whose layers `head`, a file without cells, describes.
    pub(in crate::store) fn new(head: &Goblin, shard: Shard) -> Result<ShardWriter> {
        let (planned, summary) = (planned_layers(head)?, SummaryWriter::new(&shard)?);
        Ok(ShardWriter { shard, head: head.path().to_path_buf(), planned, summary, next: 0 })
    }

    /// Returns whether the shard has no cells of any layer.
    pub(in crate::store) fn is_empty(&self) -> bool {
        self.shard.ranges.is_empty()
    }

    /// Returns the shard's run of the next layer, if it has one.
    pub(in crate::store) fn run(&self) -> Option<CodeRange> {
        self.shard.range(self.next).map(|range| range.run)
    }

    /// Writes the shard's run of the next layer, if it has one, from the parts that `fill` pushes.
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
        // (Callers that pass the planned metadata have already completed them.)
        self.check_planned(layer, header, &[&metadata, &options.metadata])?;
        let Some(range) = self.shard.range(layer).copied() else { return Ok(()) };
        let run = self.shard.run_path(layer);
        if !in_order {
            let advice = "read the cells in FD order, or build the file in a single process";
            return Err(Error::unsupported(run, "a shard of cells in another order than FD order", advice));
        }
        self.summary.begin(range);
        let mut writer = RangeWriter::new(run, range, header, &mut self.summary);
        let mut builder = SegmentBuilder::new(header, covered, &mut writer);
        fill(&mut builder, header.shape)?;
        let (_, counts) = builder.finish();
        let bytes = writer.finish()?;
        self.summary.end(bytes, counts)
    }

    /// Checks that a layer is as planned, except for the paths of its inputs.
    fn check_planned(&self, layer: u32, header: &Header, metadata: &[&Metadata]) -> Result<()> {
        // (Compared as bytes, because NaN is not equal to itself.)
        let identity_of = |metadata: &Metadata| -> Result<(String, Vec<u8>)> {
            let counts = Default::default();
            let alike = Metadata { counts, provenance: Vec::new(), ..metadata.clone() };
            Ok((metadata.name.clone(), alike.to_bytes(&self.head)?))
        };
        let planned = self.planned.get(layer as usize);
        let metadata = metadata.iter().map(|metadata| identity_of(metadata)).collect::<Result<Vec<_>>>()?;
        let (found, expected) = match planned {
            Some((planned, planned_metadata))
                if planned == header && metadata.contains(&identity_of(planned_metadata)?) =>
            {
                return Ok(());
            }
            Some((planned, _)) if planned == header => {
                (format!("layer {layer} would have different metadata"), "the metadata of the head".into())
            }
            Some((planned, _)) => {
                (format!("layer {layer} would have {}", described(header)), described(planned))
            }
            None => (
                format!("the file would have a layer {layer}"),
                format!("a file of {} layers", self.planned.len()),
            ),
        };
        let advice = "the inputs or the program have changed: plan a new job in another directory";
        Err(Error::PlanMismatch { path: self.head.clone(), found, expected, advice })
    }

    /// Marks the shard as complete.
    pub(in crate::store) fn finish(self) -> Result<()> {
        self.summary.finish()
    }
}

/// Describes a layer for messages.
fn described(header: &Header) -> String {
    let [x, y, z] = header.extent;
    let Header { form, rule, kind, codec, .. } = header;
    let depth = header.depth();
    format!("{x} x {y} x {z} cells of {} in {depth} levels, {kind}, {rule}, {}", form.value, codec.name())
}

/// Returns header and metadata of each layer of a file.
pub(super) fn planned_layers(head: &Goblin) -> Result<Vec<(Header, Metadata)>> {
    let layer = |number| {
        let layer = head.open_layer(number)?;
        Ok((layer.header().clone(), layer.metadata().clone()))
    };
    (0..head.layers().len()).map(layer).collect()
}

/// Writes the segments of a shard's run consecutively to a run file, which is created with the
/// first segment.
struct RangeWriter<'l> {
    path: PathBuf,
    out: Option<Output>,
    range: ShardRange,
    header: Header,
    /// Bytes so far.
    position: u64,
    /// File order of the last segment.
    last: u64,
    entries: PendingEntries,
    summary: &'l mut SummaryWriter<LevelCounts>,
}

impl<'l> RangeWriter<'l> {
    fn new(
        path: PathBuf,
        range: ShardRange,
        header: &Header,
        summary: &'l mut SummaryWriter<LevelCounts>,
    ) -> RangeWriter<'l> {
        let header = header.clone();
        RangeWriter {
            path,
            out: None,
            range,
            header,
            position: 0,
            last: 0,
            entries: PendingEntries::default(),
            summary,
        }
    }

    fn put(&mut self, parts: [&[u8]; 2], entry: Entry) -> Result<()> {
        let shard_level = self.header.shape.shard_level();
        let order = file_order(entry.code, shard_level);
        // Invariant: segments arrive in file order, and none is of the top levels. So the merged
        // file has them in the order of the run files, shard by shard, and merging only moves them.
        debug_assert!(entry.code.level() >= shard_level && self.range.run.contains(entry.code));
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

    /// Moves the run file to its final path, and returns its size in bytes.
    fn finish(mut self) -> Result<u64> {
        self.entries.write(self.summary, self.header.form.value)?;
        self.out.map_or(Ok(()), Output::commit)?;
        Ok(self.position)
    }
}

impl SegmentSink for RangeWriter<'_> {
    fn path(&self) -> &Path {
        &self.path
    }

    fn stop(&self) -> Option<u8> {
        Some(self.header.shape.shard_level())
    }

    fn top(&mut self, part: EncodedSubtree) -> Result<()> {
        // (Nodes outside of the extent are known to be VOID and are not stored.)
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

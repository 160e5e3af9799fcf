//! Writes a Goblin file: header, layers, metadata, tops of the page indexes, table of layers,
//! trailer.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::layer_writer::LayerWriter;
use super::reader::Goblin;
use super::reference::{PAGES_TAG, SOURCES_TAG};
use super::segment_builder::{ALL_HAS_COME, SegmentBuilder};
use crate::store::builder::{BuildOptions, Fill};
use spinney_base::io::Output;
use spinney_base::parallel;
use spinney_base::value::ZoneStats;
use spinney_base::{Error, Progress, Result};
use spinney_container::{
    Codec, FileHeader, HEADER_SIZE, Header, Layer, LayerTable, LevelCounts, Metadata, Section, Trailer,
};

/// Metadata that exceed this number of bytes are stored before those of the other layers, so that
/// the last bytes of a file describe most of it.
const LARGE_METADATA: usize = 4096;
/// Number of packed segments that are checked at a time, by all threads.
const UNPACKED_AT_ONCE: usize = 64;
/// Bytes that are copied at a time.
const COPY_BYTES: u64 = 1 << 20;

/// A Goblin file that is being written, append-only.
pub(in crate::store) struct FileWriter {
    out: Output,
    path: PathBuf,
    header: FileHeader,
    /// Bytes written so far.
    position: u64,
    /// Bytes of the file from an earlier process that was aborted: they are written again.
    there: u64,
    /// Layers so far, the tops of their page indexes, and their metadata.
    layers: Vec<(Layer, Vec<u8>, Vec<u8>)>,
    /// Sections other than the table of layers, by tag.
    sections: Vec<([u8; 4], Vec<u8>)>,
}

impl FileWriter {
    /// Starts a file with the number of layers in its header.
    pub(in crate::store) fn new(out: Output, header: FileHeader) -> Result<FileWriter> {
        FileWriter::over(out, 0, header)
    }

    /// Starts a file of whose bytes the output already has `there`.
    pub(super) fn over(out: Output, there: u64, header: FileHeader) -> Result<FileWriter> {
        let path = out.path().to_path_buf();
        let mut writer =
            FileWriter { out, path, header, position: 0, there, layers: Vec::new(), sections: Vec::new() };
        writer.write(&header.to_bytes(), "write the header")?;
        debug_assert_eq!(writer.position, HEADER_SIZE as u64);
        Ok(writer)
    }

    /// Returns the file, for messages.
    pub(in crate::store) fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the number of bytes written so far.
    pub(super) fn position(&self) -> u64 {
        self.position
    }

    pub(super) fn write(&mut self, bytes: &[u8], doing: &'static str) -> Result<()> {
        let over = self.there.saturating_sub(self.position).min(bytes.len() as u64) as usize;
        let (over, new) = bytes.split_at(over);
        let written = match over {
            [] => self.out.write_all(new),
            _ => self.out.overwrite(self.position, over).and_then(|()| self.out.write_all(new)),
        };
        written.map_err(Error::io(&self.path, doing))?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    /// Makes the bytes written so far durable.
    pub(super) fn sync(&mut self) -> Result<()> {
        self.out.sync().map_err(Error::io(&self.path, "sync"))
    }

    /// Writes a layer from a tree's parts, which `fill` pushes; `in_order` is whether they are in
    /// FD order.
    pub(in crate::store) fn layer(
        &mut self,
        options: &BuildOptions,
        header: &Header,
        (covered, in_order): ([u64; 3], bool),
        fill: &mut Fill<'_>,
        complete: &mut dyn FnMut(&mut Metadata),
    ) -> Result<ZoneStats> {
        let mut writer = LayerWriter::new(self, header, in_order, options.memory / 8);
        let mut builder = SegmentBuilder::new(header, covered, &mut writer);
        fill(&mut builder, header.shape)?;
        let (root, counts) = builder.finish();
        let root = root.expect(ALL_HAS_COME);
        let mut metadata = Metadata { counts, ..options.metadata.clone() };
        complete(&mut metadata);
        writer.finish(root.child, &metadata)?;
        Ok(root.tally)
    }

    /// Writes a layer from existing segments and from parts of nodes, which `fill` pushes in file
    /// order. `fill` returns the node counts per level of the shards.
    pub(super) fn merged_layer(
        &mut self,
        header: &Header,
        metadata: &Metadata,
        memory: u64,
        fill: &mut dyn FnMut(&mut SegmentBuilder<'_>) -> Result<LevelCounts>,
    ) -> Result<()> {
        let mut writer = LayerWriter::new(self, header, true, memory);
        let mut builder = SegmentBuilder::new(header, header.extent, &mut writer);
        let below = fill(&mut builder)?;
        let (root, mut counts) = builder.finish();
        counts.merge(&below);
        let Some(root) = root else {
            let (found, expected) = ("missing nodes", "all nodes of the shard level");
            return Err(Error::corrupt(&self.path, "shards", found, expected));
        };
        writer.finish(root.child, &Metadata { counts, ..metadata.clone() })
    }

    /// Copies a layer of another file unchanged, with its metadata, which may be changed.
    ///
    /// # Errors
    /// If any byte of it is corrupt, or on cancellation.
    pub(in crate::store) fn copy(
        &mut self,
        from: &Goblin,
        metadata: &Metadata,
        progress: &dyn Progress,
    ) -> Result<()> {
        // (Checked first, so that corrupt segments are not copied to another file.)
        let at_once = if from.header().codec != Codec::Plain { UNPACKED_AT_ONCE } else { 1 };
        for first in (0..from.segments()).step_by(at_once) {
            progress.check()?;
            let some: Vec<usize> = (first..from.segments().min(first + at_once)).collect();
            let read = parallel::map(&some, |segment| from.segment(*segment).map(drop));
            read.into_iter().collect::<Result<()>>()?;
        }
        let layer = from.layer().clone();
        let (start, end) = (layer.run.offset, layer.run.offset + layer.run.length);
        let run = Section { offset: self.position, ..layer.run };
        for offset in (start..end).step_by(COPY_BYTES as usize) {
            progress.check()?;
            let bytes = from.file.backend.read(offset, COPY_BYTES.min(end - offset) as usize)?;
            self.write(&bytes, "copy a layer")?;
        }
        let top = layer.top.read(&from.file.path, &*from.file.backend, "top of the index")?.into_owned();
        self.push_layer(Layer { name: metadata.name.clone(), run, ..layer }, top, metadata)
    }

    /// Adds a layer whose run has been written.
    pub(super) fn push_layer(&mut self, layer: Layer, top: Vec<u8>, metadata: &Metadata) -> Result<()> {
        let metadata = metadata.to_bytes(&self.path)?;
        self.layers.push((layer, top, metadata));
        Ok(())
    }

    /// Sets the sections that describe the cells in other files: the list of these files, and pages
    /// about them.
    pub(in crate::store) fn set_references(&mut self, sources: Vec<u8>, pages: Vec<u8>) {
        self.sections = vec![(PAGES_TAG, pages), (SOURCES_TAG, sources)];
    }

    fn section(&mut self, bytes: &[u8], doing: &'static str) -> Result<Section> {
        let (offset, length) = (self.position, bytes.len() as u64);
        self.write(bytes, doing)?;
        Ok(Section { offset, length, checksum: crc32c::crc32c(bytes) })
    }

    /// Writes the end of the file after the layers, and moves the file to its final path.
    pub(in crate::store) fn finish(mut self) -> Result<()> {
        debug_assert_eq!(self.layers.len(), self.header.layers as usize);
        let mut layers = std::mem::take(&mut self.layers);
        let mut sections = Vec::new();
        for (tag, bytes) in std::mem::take(&mut self.sections) {
            sections.push((tag, self.section(&bytes, "write the list of sources")?));
        }
        for is_large in [true, false] {
            for (layer, _, metadata) in &mut layers {
                if (metadata.len() > LARGE_METADATA) == is_large {
                    layer.metadata = self.section(metadata, "write the metadata")?;
                }
            }
        }
        for (layer, top, _) in &mut layers {
            layer.top = self.section(top, "write the index")?;
        }
        let layers: Vec<Layer> = layers.into_iter().map(|(layer, ..)| layer).collect();
        let table = LayerTable::to_bytes(&self.path, &layers)?;
        let table = self.section(&table, "write the table of layers")?;
        sections.push((LayerTable::TAG, table));
        let trailer = Trailer { header: self.header, sections };
        self.write(&trailer.to_bytes(self.position), "write the trailer")?;
        if self.there > self.position {
            self.out.truncate(self.position).map_err(Error::io(&self.path, "cut off"))?;
        }
        self.out.commit()
    }
}

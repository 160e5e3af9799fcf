//! Writes a Goblin file: header, segments as they come, directory, metadata, trailer.

use std::io::Write;
use std::path::PathBuf;

use super::directory::{Entry, NOT_COUNTED, entry_size};
use super::segment::{COUNT_SIZE, Segment};
use super::segment_builder::SegmentBuilder;
use super::segment_sink::SegmentSink;
use crate::store::builder::{BuildOptions, Fill, SealedSegment};
use crate::store::records::RecordLayout;
use crate::tree::Child;
use spinney_base::io::{Output, Sorter, folder};
use spinney_base::value::{Tally, Value};
use spinney_base::{Error, Result};
use spinney_container::{Header, Metadata, SectionWriter, Trailer, TreeFormat};

/// Makes a Goblin file of the parts of a tree, which `fill` hands over.
pub(in crate::store) fn write(
    options: &BuildOptions,
    header: Header,
    covered: [u64; 3],
    output: Output,
    fill: &mut Fill<'_>,
    complete: &mut dyn FnMut(&mut Metadata),
) -> Result<Tally> {
    let mut writer = Writer::new(output, &header, options.memory / 8)?;
    let mut builder = SegmentBuilder::new(&header, covered, &mut writer);
    fill(&mut builder, header.shape)?;
    let (root, counts) = builder.finish();
    let mut metadata = Metadata { counts, ..options.metadata.clone() };
    complete(&mut metadata);
    writer.finish(root.child, &metadata)?;
    Ok(root.tally)
}

/// A Goblin file being written, append-only.
struct Writer {
    out: Output,
    path: PathBuf,
    layout: RecordLayout,
    counts_classes: bool,
    /// Bytes written so far.
    position: u64,
    /// Directory entries of the segments written so far.
    sorter: Sorter,
    stored_records: u64,
}

impl Writer {
    /// Starts a file; about `memory` bytes hold directory entries before they go to a temporary file.
    fn new(out: Output, header: &Header, memory: u64) -> Result<Writer> {
        let path = out.path().to_path_buf();
        let sorter = Sorter::new(folder(&path), entry_size(header.form.value), memory);
        let (layout, counts_classes) = (RecordLayout::new(header.form), header.counts_classes());
        let mut writer = Writer { out, path, layout, counts_classes, position: 0, sorter, stored_records: 0 };
        writer.write(&header.to_bytes(TreeFormat::Goblin), "write the header")?;
        Ok(writer)
    }

    fn write(&mut self, bytes: &[u8], doing: &'static str) -> Result<()> {
        self.out.write_all(bytes).map_err(Error::io(&self.path, doing))?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    /// Writes what stands after the segments and puts the file in its place.
    fn finish(self, root: Child<()>, metadata: &Metadata) -> Result<()> {
        let Writer { mut out, path, position, sorter, stored_records, .. } = self;
        let metadata = metadata.to_bytes(&path)?;
        let segments = sorter.len();

        let mut section = SectionWriter::new(&mut out, position);
        sorter
            .finish(&mut |entry| section.write_all(entry).map_err(Error::io(&path, "write the directory")))?;
        let directory = section.written;

        let mut section = SectionWriter::new(&mut out, directory.offset + directory.length);
        section.write_all(&metadata).map_err(Error::io(&path, "write the metadata"))?;
        let metadata = section.written;

        let mut root_value = [0; 32];
        let value = root.value().unwrap_or_default().to_bytes();
        root_value[..value.len()].copy_from_slice(&value);
        let root_state = root.state() as u8;
        let more = Vec::new();
        let trailer = Trailer { root_state, root_value, segments, stored_records, directory, metadata, more };
        let before = metadata.offset + metadata.length;
        out.write_all(&trailer.to_bytes(before)).map_err(Error::io(&path, "write the trailer"))?;
        out.commit()
    }
}

impl SegmentSink for Writer {
    fn segment(&mut self, segment: SealedSegment) -> Result<()> {
        let offset = self.position;
        let SealedSegment { code, records, tally } = segment;
        let listed = if self.counts_classes { tally.listed_classes() } else { Some(&[][..]) };
        let classes = class_bytes(self.layout.width, listed.unwrap_or_default());
        let checksum = crc32c::crc32c_append(crc32c::crc32c(&records), &classes);
        self.write(&records, "write a segment")?;
        self.write(&classes, "write a segment")?;
        let count = self.layout.count(&records);
        self.stored_records += count as u64;
        let entry = Entry {
            code,
            offset,
            length: self.position - offset,
            records: count as u32,
            classes: listed.map_or(NOT_COUNTED, |classes| classes.len() as u32),
            checksum,
            zone: tally,
        };
        self.sorter.push(code.bits(), entry.to_bytes())
    }

    fn copy(&mut self, segment: &Segment<'_>, mut entry: Entry) -> Result<()> {
        entry.offset = self.position;
        self.write(segment.all_bytes(), "write a segment")?;
        self.stored_records += u64::from(entry.records);
        self.sorter.push(entry.code.bits(), entry.to_bytes())
    }
}

/// Class counts as they stand behind a segment's records: the value's bytes, of which there are `width`, then
/// the cells.
fn class_bytes(width: usize, classes: &[(Value, u64)]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(classes.len() * (width + COUNT_SIZE));
    for (value, cells) in classes {
        bytes.extend_from_slice(&value.to_bytes()[..width]);
        bytes.extend_from_slice(&cells.to_le_bytes());
    }
    bytes
}

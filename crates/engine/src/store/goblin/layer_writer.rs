//! Writes one layer: its segments in the order of arrival, then those of the top levels, then the
//! segment index.

use std::path::Path;

use super::deferred::{DeferredSegments, file_order};
use super::directory::{Entry, SegmentLocation, entry_size, set_offset};
use super::directory_writer::DirectoryWriter;
use super::file_writer::FileWriter;
use super::packed::class_counts;
use super::reference::Reference;
use super::segment_sink::SegmentSink;
use crate::store::builder::SealedSegment;
use crate::store::records::RecordLayout;
use crate::tree::Child;
use spinney_base::Result;
use spinney_base::io::{Sorter, directory_of};
use spinney_container::{Codec, Header, Layer, Metadata, Section};

/// A layer that is being written, append-only.
pub(super) struct LayerWriter<'f> {
    file: &'f mut FileWriter,
    header: Header,
    /// Offset of the layer's run in the file.
    start: u64,
    /// Whether segments arrive in file order, except for those of the top levels.
    in_order: bool,
    shard_level: u8,
    /// File order of the last segment that was written immediately.
    last: u64,
    /// Entries of the segments written so far.
    entries: Sorter,
    /// Segments that are written later.
    deferred: DeferredSegments,
    stored_records: u64,
}

impl<'f> LayerWriter<'f> {
    /// Starts a layer. About `memory` bytes are used for delayed segments and entries before they
    /// go to temporary files.
    pub(super) fn new(
        file: &'f mut FileWriter,
        header: &Header,
        in_order: bool,
        memory: u64,
    ) -> LayerWriter<'f> {
        let size = entry_size(header.form.value);
        let entries = Sorter::new(directory_of(file.path()), memory / 2);
        let deferred = DeferredSegments::new(file.path(), size, memory / 2);
        let (start, shard_level) = (file.position(), header.shape.shard_level());
        LayerWriter {
            file,
            header: header.clone(),
            start,
            in_order,
            shard_level,
            last: 0,
            entries,
            deferred,
            stored_records: 0,
        }
    }

    /// Adds a segment, whose bytes are given in two slices, and sets the offset in its entry.
    fn put(&mut self, parts: [&[u8]; 2], mut entry: Entry) -> Result<()> {
        self.stored_records += u64::from(entry.records);
        let order = file_order(entry.code, self.shard_level);
        if !self.in_order || entry.code.level() < self.shard_level {
            entry.offset = self.deferred.len();
            return self.deferred.push(order, parts, &entry.to_bytes());
        }
        debug_assert!(self.last <= order, "segments come in the order of the file");
        self.last = order;
        entry.offset = self.file.position() - self.start;
        for part in parts {
            self.file.write(part, "write a segment")?;
        }
        self.entries.push(entry.code.bits(), &entry.to_bytes())
    }

    /// Writes the delayed segments and the segment index.
    pub(super) fn finish(self, root: Child<()>, metadata: &Metadata) -> Result<()> {
        let LayerWriter { file, header, start, mut entries, deferred, stored_records, .. } = self;
        let mut top_levels = None;
        let place = |entry: &[u8]| {
            let location = SegmentLocation::read(entry).expect("a whole entry");
            (location.offset, location.length)
        };
        deferred.finish(place, &mut |order, entry, bytes| {
            let offset = file.position() - start;
            if order >> 63 != 0 {
                top_levels.get_or_insert(offset);
            }
            file.write(bytes, "write a segment")?;
            let mut entry = entry.to_vec();
            set_offset(&mut entry, offset);
            let code = u64::from_le_bytes(entry[..8].try_into().expect("8 bytes"));
            entries.push(code, &entry)
        })?;
        let directory = file.position() - start;
        let segments = entries.len();
        let mut write = |bytes: &[u8]| file.write(bytes, "write the directory");
        let mut pages = DirectoryWriter::new(&header, directory, &mut write);
        entries.finish(&mut |entry| pages.push(entry))?;
        let top = pages.finish()?;
        let mut root_value = [0; 16];
        root_value.copy_from_slice(&root.value().unwrap_or_default().to_bytes());
        let layer = Layer {
            name: metadata.name.clone(),
            header,
            root_state: root.state() as u8,
            root_value,
            segments,
            stored_records,
            run: Section { offset: start, length: file.position() - start, checksum: 0 },
            top_levels: top_levels.unwrap_or(directory),
            directory,
            top: Section::default(),
            metadata: Section::default(),
        };
        file.push_layer(layer, top, metadata)
    }
}

/// Receiver of a segment: its bytes in two slices, and its entry.
pub(super) type Put<'p> = dyn FnMut([&[u8]; 2], Entry) -> Result<()> + 'p;

/// Passes the bytes of a segment in two slices and its entry, whose offset is not set yet, to
/// `put`.
pub(super) fn with_entry(header: &Header, segment: SealedSegment, put: &mut Put<'_>) -> Result<()> {
    let (classes, counts) = class_counts(header, &segment.tally);
    let SealedSegment { code, records, tally, packed } = segment;
    let reference;
    let (codec, parts) = match &packed {
        _ if header.is_referenced(code.level()) => {
            reference = Reference::of(header, code.level(), &records, &tally).to_bytes(header.form.width());
            (Codec::Reference, [&reference[..], &[]])
        }
        Some(packed) => (Codec::Packed, [&packed[..], &[]]),
        None => (Codec::Plain, [&records[..], &counts]),
    };
    let entry = Entry {
        code,
        offset: 0,
        length: (parts[0].len() + parts[1].len()) as u64,
        records: RecordLayout::new(header.form).count(&records) as u32,
        classes,
        codec,
        checksum: crc32c::crc32c_append(crc32c::crc32c(parts[0]), parts[1]),
        zone: tally,
    };
    put(parts, entry)
}

impl SegmentSink for LayerWriter<'_> {
    fn path(&self) -> &Path {
        self.file.path()
    }

    fn codec(&self) -> Codec {
        self.header.codec
    }

    fn segment(&mut self, segment: SealedSegment) -> Result<()> {
        let header = self.header.clone();
        with_entry(&header, segment, &mut |parts, entry| self.put(parts, entry))
    }

    fn sync(&mut self) -> Result<()> {
        self.file.sync()
    }

    fn copy(&mut self, bytes: &[u8], entry: Entry) -> Result<()> {
        self.put([bytes, &[]], entry)
    }
}

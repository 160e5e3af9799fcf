//! Appends records to a file in extents and completes commits.

use std::io;
use std::mem;
use std::path::PathBuf;
use std::sync::Arc;

use super::commit::{Commit, WriteSummary};
use super::extents::{ByteAccess, EXTENT_MAGIC, ExtentKind, Extents, FULL_EXTENT, HEAD_SIZE, head};
use super::layout::{PointeredLayout, Pointers};
use super::meta::Meta;
use super::packed::{PackedExtents, PackedWriter};
use super::pages::{PAGE, SECTOR};
use super::reader::Autumnal;
use super::share::{DedupTable, hash};
use spinney_base::io::{ReadBackend, WriteBackend, directory_of};
use spinney_base::value::Value;
use spinney_base::{Error, Result};

/// Buffer size in bytes at which the buffer is written.
const MAX_BUFFERED: usize = 4 << 20;

/// Record to be stored in the file.
#[derive(Clone, Copy)]
pub(super) struct NewRecord<'a> {
    /// Height of its node.
    pub(super) height: u8,
    pub(super) representative: Value,
    pub(super) pointers: &'a Pointers,
    /// The levels below the node, encoded as a run.
    pub(super) run: &'a [u8],
    /// Encoded zone; empty if the record has none.
    pub(super) zone: &'a [u8],
}

/// Writer that appends to a file.
pub(super) struct Appender {
    pub(super) backend: Box<dyn WriteBackend>,
    path: PathBuf,
    layout: PointeredLayout,
    /// File offset of the buffer's first byte.
    start: u64,
    /// Bytes that are not written yet.
    buffer: Vec<u8>,
    /// Buffer offset and kind of the open extent.
    extent: Option<(usize, ExtentKind)>,
    /// Records written and shared since the last commit. (The editor counts the bytes, by offsets.)
    pub(super) written: WriteSummary,
    /// Records that this writer has written, if equal subtrees are stored once. It does not have
    /// those that were in the file before: they are shared only with the same node of the edited
    /// tree, by the caller.
    dedup: Option<DedupTable>,
    /// Reader of the written bytes, to compare them with new records. Reopened after each write.
    reader: Option<Box<dyn ReadBackend>>,
    /// Extents of the written bytes, if records are packed.
    extents: Option<Extents>,
    /// Open extent of packed records, if records are packed.
    packed: Option<(PackedWriter, Arc<PackedExtents>)>,
    /// Buffer for the content of a record to be deduplicated.
    content: Vec<u8>,
    /// Whether a write or sync failed, after which the state of the disk is unknown.
    is_poisoned: bool,
}

impl Appender {
    /// Creates a writer that appends after `end`. `share` is the memory in bytes for deduplicating
    /// subtrees; any excess goes to a temporary file in the same directory.
    pub(super) fn new(
        backend: Box<dyn WriteBackend>,
        path: PathBuf,
        layout: PointeredLayout,
        end: u64,
        share: Option<u64>,
    ) -> Appender {
        let dedup = share.map(|memory| DedupTable::new(memory, directory_of(&path)));
        Appender {
            backend,
            path,
            layout,
            start: end.next_multiple_of(PAGE),
            buffer: Vec::new(),
            extent: None,
            written: WriteSummary::default(),
            dedup,
            reader: None,
            extents: None,
            packed: None,
            content: Vec::new(),
            is_poisoned: false,
        }
    }

    /// Returns whether equal subtrees are stored once.
    pub(super) fn shares(&self) -> bool {
        self.dedup.is_some()
    }

    /// Switches to records of another tree.
    ///
    /// Invariant: records may be shared between trees of different types, so known records are
    /// kept. A record is shared if its bytes, read with the layout of the present tree, are those
    /// of the new record ([`Self::size_of`]); then it means the same in this tree.
    pub(super) fn set_tree(&mut self, tree: &Autumnal) {
        self.close_extent();
        self.layout = tree.layout().clone();
        if let Some((writer, _)) = &mut self.packed {
            writer.set_tree(tree.header());
        }
    }

    /// Packs all further records.
    pub(super) fn pack(&mut self, writer: PackedWriter, reader: Arc<PackedExtents>) -> Result<()> {
        self.flush()?;
        self.packed = Some((writer, reader));
        Ok(())
    }

    /// Returns the file offset of the next byte.
    pub(super) fn position(&self) -> u64 {
        self.start + self.buffer.len() as u64
    }

    /// Ensures that an extent of `kind` is open and not full.
    fn open_extent(&mut self, kind: ExtentKind) -> Result<()> {
        if let Some((start, open)) = self.extent
            && (open != kind || self.buffer.len() - start > FULL_EXTENT)
        {
            self.close_extent();
        }
        // (An open extent that is not full exceeds this limit by at most its own size.)
        if self.buffer.len() > MAX_BUFFERED {
            self.flush()?;
        }
        if self.extent.is_none() {
            self.extent = Some((self.buffer.len(), kind));
            // The head is filled in when the extent is closed.
            self.buffer.resize(self.buffer.len() + HEAD_SIZE, 0);
        }
        Ok(())
    }

    /// Closes the open extent, if there is one.
    fn close_extent(&mut self) {
        self.close_packed();
        // Invariant: an open extent is entirely in the buffer, since it is closed before every
        // write. So its head can be filled in here, the checksum covers bytes that were never read
        // back, and a search of the buffer finds all values that look like a head.
        let Some((start, kind)) = self.extent.take() else { return };
        let offset = self.start + start as u64;
        let head = head(kind, offset, &self.buffer[start + HEAD_SIZE..]);
        self.buffer[start..start + HEAD_SIZE].copy_from_slice(&head);
        let end = self.position().next_multiple_of(SECTOR);
        self.buffer.resize((end - self.start) as usize, 0);
    }

    /// Closes the extent of packed records, if it has any.
    fn close_packed(&mut self) {
        // (No other extent is open: with packing all records go to this one.)
        let Some((writer, _)) = self.packed.as_mut().filter(|(writer, _)| !writer.is_empty()) else { return };
        let payload = writer.finish();
        let head = head(ExtentKind::Packed, self.position(), &payload);
        self.buffer.extend_from_slice(&head);
        self.buffer.extend_from_slice(&payload);
        let end = self.position().next_multiple_of(SECTOR);
        self.buffer.resize((end - self.start) as usize, 0);
    }

    /// Adds a record to the extent of packed records. Returns `None` if records are not packed.
    fn write_packed(&mut self, record: NewRecord<'_>) -> Result<Option<u64>> {
        let Some((writer, _)) = &self.packed else { return Ok(None) };
        // (Write it, so that new records can be compared with the extent's.)
        if writer.is_full() {
            self.flush()?;
        }
        // Invariant: the extent starts at the file position of its first record, since nothing else
        // is written before it is closed. So addresses are known before anything is packed.
        let start = self.position();
        self.written.records += 1;
        Ok(self.packed.as_mut().map(|(writer, _)| writer.push(start, record)))
    }

    /// Closes the open extent and writes the buffer.
    pub(super) fn flush(&mut self) -> Result<()> {
        self.close_extent();
        if !self.buffer.is_empty() {
            let buffer = mem::take(&mut self.buffer);
            self.write_at("write", self.start, &buffer)?;
            self.start += buffer.len() as u64;
            // Reuse the allocation.
            self.buffer = buffer;
            self.buffer.clear();
            self.reader = None;
            self.extents = None;
        }
        Ok(())
    }

    fn write_at(&mut self, doing: &'static str, offset: u64, bytes: &[u8]) -> Result<()> {
        self.refuse_poisoned()?;
        let written = self.backend.write(offset, bytes);
        self.poison_unless(doing, written)
    }

    fn sync(&mut self) -> Result<()> {
        self.refuse_poisoned()?;
        let synced = self.backend.sync();
        self.poison_unless("sync", synced)
    }

    /// Checks that the file is still at the path where readers open it.
    fn check_path(&mut self) -> Result<()> {
        let checked = self.backend.check_path();
        self.is_poisoned = checked.is_err();
        checked
    }

    /// Fails after an earlier failure. The state of the disk is unknown then and a retry would not
    /// reveal it, so nothing more is written.
    fn refuse_poisoned(&self) -> Result<()> {
        if self.is_poisoned { Err(Error::Poisoned { path: self.path.clone() }) } else { Ok(()) }
    }

    fn poison_unless(&mut self, doing: &'static str, done: io::Result<()>) -> Result<()> {
        self.is_poisoned = done.is_err();
        done.map_err(Error::io(&*self.path, doing))
    }

    /// Writes a record and returns its address, or the address of an equal one.
    pub(super) fn record(&mut self, record: NewRecord<'_>) -> Result<u64> {
        match self.dedup.take() {
            Some(mut dedup) => {
                let address = self.share(&mut dedup, record);
                self.dedup = Some(dedup);
                address
            }
            None => self.write_record(record),
        }
    }

    fn write_record(&mut self, record: NewRecord<'_>) -> Result<u64> {
        if let Some(address) = self.write_packed(record)? {
            return Ok(address);
        }
        self.open_extent(ExtentKind::Records)?;
        let mut address = self.position();
        self.encode_record(address, record);
        // Invariant: between an extent's start and the start of its last record, no sector boundary
        // has the magic number of a head. Readers search backwards from a record to the nearest
        // head, and values can look like one. Then no record may start there or later in the same
        // extent: readers would take the values for a head and reject a good record as corrupt.
        if let Some(place) = self.magic_since(address) {
            if place <= address {
                // The false head contains or precedes this record's first byte.
                self.buffer.truncate((address - self.start) as usize);
                self.close_extent();
                self.open_extent(ExtentKind::Records)?;
                address = self.position();
                self.encode_record(address, record);
            }
            if self.magic_since(address).is_some() {
                self.close_extent();
            }
        }
        self.written.records += 1;
        Ok(address)
    }

    /// Appends a record to the buffer.
    fn encode_record(&mut self, address: u64, record: NewRecord<'_>) {
        let NewRecord { height, representative, pointers, run, zone } = record;
        self.layout.encode((address, height), representative, pointers, run, &mut self.buffer);
        self.buffer.extend_from_slice(zone);
    }

    /// Returns the first sector boundary with a head's magic number that extends beyond `address`
    /// by at least one byte.
    fn magic_since(&self, address: u64) -> Option<u64> {
        let (length, end) = (EXTENT_MAGIC.len() as u64, self.position());
        let first = (address + 1).saturating_sub(length).next_multiple_of(SECTOR);
        // (The open extent's own head is not written yet.)
        (first..end).step_by(SECTOR as usize).find(|place| {
            place
                .checked_sub(self.start)
                .is_some_and(|at| self.buffer[at as usize..].starts_with(&EXTENT_MAGIC))
        })
    }

    /// Encodes a record independently of its own address: pointers are stored as absolute
    /// addresses.
    fn content_of(content: &mut Vec<u8>, record: NewRecord<'_>, width: usize) {
        let NewRecord { height, representative, pointers, run, zone } = record;
        content.clear();
        content.push(height);
        content.extend_from_slice(&representative.to_bytes()[..width]);
        content.extend_from_slice(&pointers.bitmap.to_le_bytes());
        pointers.targets.iter().for_each(|target| content.extend_from_slice(&target.to_le_bytes()));
        content.extend_from_slice(run);
        content.extend_from_slice(zone);
    }

    /// Returns the address of an equal record of this writer, or writes the record.
    fn share(&mut self, dedup: &mut DedupTable, record: NewRecord<'_>) -> Result<u64> {
        let mut content = mem::take(&mut self.content);
        Self::content_of(&mut content, record, self.layout.width());
        let hash = hash(&content);
        let known = dedup.find(hash)?;
        let mut found = None;
        for address in known {
            found = self.size_with(address, &content, record)?.map(|size| (address, size));
            if found.is_some() {
                break;
            }
        }
        self.content = content;
        if let Some((address, size)) = found {
            self.written.shared += 1;
            self.written.spared += size as u64;
            return Ok(address);
        }
        let address = self.write_record(record)?;
        dedup.insert(hash, address)?;
        Ok(address)
    }

    /// Returns the size in bytes of the record at `address` if it has this content. `new` is a
    /// record of the same height with the content.
    fn size_with(&mut self, address: u64, content: &[u8], new: NewRecord<'_>) -> Result<Option<usize>> {
        if self.packed.is_some() {
            return self.packed_size_with(address, content, new);
        }
        if address < self.start && self.reader.is_none() {
            self.reader = Some(self.backend.reader()?);
        }
        // (Height and absolute addresses take at least as many bytes as pointers in a record.)
        let most = content.len();
        let read;
        let bytes = match (&self.reader, address.checked_sub(self.start)) {
            // It is still in the buffer.
            (_, Some(at)) => &self.buffer[at as usize..],
            (Some(reader), None) if address < reader.len() => {
                let most = (reader.len() - address).min(most as u64);
                read = reader.read(address, most as usize)?;
                &read[..]
            }
            _ => return Ok(None),
        };
        Ok(self.size_of(bytes, address, content, new))
    }

    /// Does the same as [`Self::size_with`] in a file with packed records.
    fn packed_size_with(
        &mut self,
        address: u64,
        content: &[u8],
        new: NewRecord<'_>,
    ) -> Result<Option<usize>> {
        let Some((writer, reader)) = &self.packed else { return Ok(None) };
        if let Some(bytes) = writer.record(address) {
            return Ok(self.size_of(bytes, address, content, new));
        }
        let reader = reader.clone();
        if address >= self.start {
            self.flush()?;
        }
        let extents = match self.extents.take() {
            Some(extents) => extents,
            None => {
                let extents = Extents::new(&self.path, self.backend.reader()?, self.start, false)?;
                extents.with_packed(Some(reader))
            }
        };
        // (Height and absolute addresses take at least as many bytes as pointers in a record.)
        let size =
            (&extents).bytes(address, content.len()).map(|bytes| self.size_of(&bytes, address, content, new));
        self.extents = Some(extents);
        size
    }

    /// Returns the size in bytes of a record if it has this content.
    fn size_of(&self, bytes: &[u8], address: u64, content: &[u8], new: NewRecord<'_>) -> Option<usize> {
        let fields = self.layout.fields(bytes, new.height).ok()?;
        let representative = self.layout.representative(bytes)?;
        let zone = bytes.get(fields.end..fields.end + new.zone.len())?;
        let pointers = fields.pointers(bytes, address)?;
        let mut found = Vec::with_capacity(content.len());
        let record = NewRecord {
            height: new.height,
            representative,
            pointers: &pointers,
            run: fields.run(bytes),
            zone,
        };
        Self::content_of(&mut found, record, self.layout.width());
        (found == content).then_some(fields.end + zone.len())
    }

    /// Writes a separate extent and returns its offset.
    pub(super) fn extent(&mut self, kind: ExtentKind, bytes: &[u8]) -> Result<u64> {
        self.close_extent();
        self.open_extent(kind)?;
        let start = self.position() - HEAD_SIZE as u64;
        self.buffer.extend_from_slice(bytes);
        self.close_extent();
        Ok(start)
    }

    /// Makes everything written so far durable, then makes `commit` the newest. Returns the meta
    /// slot.
    pub(super) fn commit(&mut self, commit: &Commit) -> Result<Meta> {
        let start = self.extent(ExtentKind::Commit, &commit.to_bytes()?)?;
        self.flush()?;
        let meta = Meta { sequence: commit.sequence, commit: start, end: self.position() };
        // Invariant: at any time one slot refers to a commit that is entirely durable. This slot
        // replaces the slot of the commit before the last, after its own commit has become durable,
        // and it is reported only once the slot is durable as well. Without the first sync, a crash
        // could leave a slot that refers to missing bytes. Without the second one, acknowledged
        // edits could be lost.
        self.sync()?;
        // A commit to a file that was moved or replaced must not be reported either. Before the
        // slot is written there is no commit yet; after it, the commit is where the file is now.
        self.check_path()?;
        self.write_at("write the meta slot", meta.offset(), &meta.to_bytes())?;
        self.sync()?;
        self.check_path()?;
        // Invariant: no page of a commit is written again. A torn write of the next commit would
        // corrupt durable bytes.
        self.start = self.start.next_multiple_of(PAGE);
        self.written = WriteSummary::default();
        Ok(meta)
    }
}

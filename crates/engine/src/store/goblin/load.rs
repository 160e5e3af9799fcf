//! Loading of segments: checked on first use, and read through the file's backend.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::directory::{Entry, SegmentLocation, listed};
use super::packed::segment_form;
use super::reader::Goblin;
use super::segment::{COUNT_SIZE, Segment};
use spinney_base::io::FileBytes;
use spinney_base::space::Code;
use spinney_base::{Error, Result};
use spinney_container::Codec;
use spinney_packing::{Corruption, may_unpack, unpack};

impl Goblin {
    /// Returns one segment.
    ///
    /// # Errors
    /// If it is corrupt or cannot be read.
    ///
    /// # Panics
    /// If there is no such segment.
    #[inline]
    pub fn segment(&self, index: usize) -> Result<Segment<'_>> {
        if self.is_checked(index) { self.load(index) } else { self.check_segment(index) }
    }

    /// Returns whether a segment was checked and found valid.
    #[inline]
    fn is_checked(&self, index: usize) -> bool {
        self.checked[index / 64].load(Ordering::Relaxed) >> (index % 64) & 1 != 0
    }

    /// Loads a segment that is used for the first time, and does all checks that do not depend on
    /// the traversal.
    #[cold]
    fn check_segment(&self, index: usize) -> Result<Segment<'_>> {
        let entry = self.entry(index)?;
        let part = || format!("segment {} (entry {index})", entry.code);
        let plain = self.plain_length(entry.records, listed(entry.classes));
        if entry.records == 0 || entry.codec == Codec::Plain && entry.length != plain {
            let found = format!("{} bytes, {} records", entry.length, entry.records);
            return Err(self.corrupt(part(), found, "the bytes of all records and class counts"));
        }
        if entry.codec != Codec::Plain && self.header.codec == Codec::Plain {
            return Err(self.corrupt(part(), "a packed segment", "a plain segment, the codec of the tree"));
        }
        let level = entry.code.level();
        if (entry.codec == Codec::Reference) != self.header.is_referenced(level) {
            let found = format!("{} segment at level {level}", entry.codec.name());
            return Err(self.corrupt(part(), found, "references at the level of the blocks, and only there"));
        }
        let available = self.layer().directory;
        if entry.offset.checked_add(entry.length).is_none_or(|end| end > available) {
            let found = format!("{} bytes at {}", entry.length, entry.offset);
            return Err(self.corrupt(part(), found, "bytes before the directory"));
        }
        if self.header.shape.segment_level(level) != level {
            return Err(self.corrupt(part(), format!("level {level}"), "a level that has segments"));
        }
        // Segments must not overlap. Otherwise a small file could claim many large ones and take
        // hours to traverse. (Another thread may have checked this segment meanwhile. It sets the
        // segment's bit before it adds the bytes, so a thread that sees the bytes also sees the
        // bit.)
        if self.checked_bytes.load(Ordering::Acquire) + entry.length > available && !self.is_checked(index) {
            return Err(self.corrupt(part(), "bytes of another segment", "segments that do not overlap"));
        }
        let segment = match entry.codec {
            Codec::Plain => {
                let segment = self.load(index)?;
                self.check_checksum(index, &entry, segment.all_bytes())?;
                segment
            }
            Codec::Packed => {
                let stored = self.stored_bytes(entry.offset, entry.length as usize);
                let stored = stored?.ok_or_else(|| self.changed(index))?;
                self.check_checksum(index, &entry, &stored)?;
                let bytes =
                    self.unpack(index, (entry.code, entry.records, listed(entry.classes)), &stored)?;
                self.segment_of(index, entry.code, bytes, entry.records)?
            }
            Codec::Reference => {
                let bytes = self.referenced(index, &entry)?;
                self.segment_of(index, entry.code, bytes, entry.records)?
            }
        };
        // All traversals start at the first record. Its extent is known, so each step down can
        // check that of the next record.
        let skip = self.layout.head(segment.records(), 0).map_or(0, |head| head.skip);
        if skip != entry.records {
            let expected = format!("{}, all records", entry.records);
            return Err(self.corrupt(part(), format!("a first skip of {skip}"), &expected));
        }
        let counted = segment.classes().iter().try_fold(0u64, |sum, (_, cells)| sum.checked_add(*cells));
        if entry.classes == 0 && self.header.counts_classes() {
            return Err(self.corrupt(part(), "no class counts", "class counts, or the mark for too many"));
        }
        if listed(entry.classes) > 0 && counted != Some(entry.zone.cells) {
            let expected = format!("{}, the cells in the directory", entry.zone.cells);
            return Err(self.corrupt(part(), format!("class counts of {counted:?} cells"), &expected));
        }
        // Two threads may have checked it at the same time: the one that sets the bit counts the
        // bytes, once.
        let bit = 1u64 << (index % 64);
        if self.checked[index / 64].fetch_or(bit, Ordering::Relaxed) & bit == 0 {
            self.checked_bytes.fetch_add(entry.length, Ordering::Release);
        }
        Ok(segment)
    }

    /// Returns the size in bytes of records and class counts.
    #[inline]
    pub(super) fn plain_length(&self, records: u32, classes: u16) -> u64 {
        u64::from(records) * self.layout.size as u64
            + u64::from(classes) * (self.layout.width + COUNT_SIZE) as u64
    }

    pub(super) fn check_checksum(&self, index: usize, entry: &Entry, bytes: &[u8]) -> Result<()> {
        let checksum = if self.file.check { crc32c::crc32c(bytes) } else { entry.checksum };
        if checksum != entry.checksum {
            let part = format!("segment {} (entry {index})", entry.code);
            let expected = format!("{:08x}", entry.checksum);
            return Err(self.corrupt(part, format!("checksum {checksum:08x}"), &expected));
        }
        Ok(())
    }

    /// Returns the error for mapped bytes that have changed since they were checked, which must not
    /// lead to reads outside of the file.
    #[cold]
    pub(super) fn changed(&self, index: usize) -> Error {
        let part = format!("directory entry {index}");
        self.corrupt(part, "different numbers than before", "an unchanged file (was it overwritten?)")
    }

    /// Returns bytes of the layer's run; `None` if a mapped file does not have that many.
    #[inline]
    pub(super) fn stored_bytes(&self, offset: u64, length: usize) -> Result<Option<FileBytes<'_>>> {
        // (No overflow: both were within the run when they were checked. If they have changed, no
        // bytes are found.)
        let offset = self.layer().run.offset.wrapping_add(offset);
        match self.file.backend.bytes() {
            Some(all) => {
                let bytes = all.get(offset as usize..).and_then(|rest| rest.get(..length));
                Ok(bytes.map(FileBytes::Mapped))
            }
            None => self.file.backend.share(offset, length).map(Some),
        }
    }

    /// Returns the bytes of a segment as stored in the file.
    pub(super) fn stored_segment(&self, index: usize) -> Result<FileBytes<'_>> {
        let entry = SegmentLocation::read(&self.entry_bytes(index)?).ok_or_else(|| self.changed(index))?;
        self.stored_bytes(entry.offset, entry.length as usize)?.ok_or_else(|| self.changed(index))
    }

    /// Loads a segment whose entry was checked.
    #[inline]
    fn load(&self, index: usize) -> Result<Segment<'_>> {
        let changed = || self.changed(index);
        let entry = SegmentLocation::read(&self.entry_bytes(index)?).ok_or_else(changed)?;
        let code = Code::from_bits(self.layout.dimension, entry.code).ok_or_else(changed)?;
        let bytes = if self.header.codec != Codec::Plain && entry.codec != Codec::Plain {
            self.unpacked(index, code, &entry)?
        } else {
            self.stored_bytes(entry.offset, entry.length as usize)?.ok_or_else(changed)?
        };
        self.segment_of(index, code, bytes, entry.records)
    }

    #[inline]
    fn segment_of<'a>(
        &self,
        index: usize,
        code: Code,
        bytes: FileBytes<'a>,
        records: u32,
    ) -> Result<Segment<'a>> {
        let record_bytes = records as usize * self.layout.size;
        if record_bytes > bytes.len() {
            return Err(self.changed(index));
        }
        Ok(Segment { code, index, bytes, record_bytes, width: self.layout.width })
    }

    /// Returns the unpacked bytes of a packed segment, or those of a reference.
    #[inline(never)]
    fn unpacked(&self, index: usize, code: Code, entry: &SegmentLocation) -> Result<FileBytes<'_>> {
        let plain = self.plain_length(entry.records, entry.classes) as usize;
        if let Some(held) = self.unpacked.get(index as u64).filter(|held| held.len() == plain) {
            return Ok(FileBytes::Cached(held));
        }
        if entry.codec == Codec::Reference {
            return self.referenced(index, &self.entry(index)?);
        }
        let stored = self.stored_bytes(entry.offset, entry.length as usize)?;
        let stored = stored.ok_or_else(|| self.changed(index))?;
        self.unpack(index, (code, entry.records, entry.classes), &stored)
    }

    /// Unpacks the bytes of a node's segment, given the numbers of its record slots and class
    /// counts.
    fn unpack(
        &self,
        index: usize,
        (node, records, classes): (Code, u32, u16),
        packed: &[u8],
    ) -> Result<FileBytes<'_>> {
        let part = || format!("segment {node} (entry {index})");
        let plain = self.plain_length(records, classes);
        if !may_unpack(packed.len() as u64, plain) {
            let found = format!("{} packed bytes for {plain} bytes", packed.len());
            return Err(self.corrupt(part(), found, "fewer unpacked bytes"));
        }
        let form = segment_form(&self.header, node).ok_or_else(|| self.changed(index))?;
        let bytes = unpack(&form, records, classes, packed).map_err(|corruption| match corruption {
            Corruption::OLDER => {
                Error::unsupported(&self.file.path, Corruption::OLDER.0, "build the file again")
            }
            Corruption(what) => self.corrupt(part(), what, "a packed segment"),
        })?;
        if bytes.len() as u64 != plain {
            return Err(self.corrupt(part(), format!("{} bytes", bytes.len()), &format!("{plain}")));
        }
        Ok(FileBytes::Cached(self.unpacked.put(index as u64, Arc::new(bytes))))
    }
}
